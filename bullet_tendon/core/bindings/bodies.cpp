// Python's access to links and bodies, by the tuples that pybullet returns.
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bodies/articulated_body.h"
#include "math/rounding.h"

namespace bt {

namespace {

// Smallest moment of inertia of a slender body, relative to its largest [-]. Larger: bodies turn about one
// axis first that need not. Smaller: forces at the ends of a rod spin it.
constexpr double kSlender = 0.1;

// Places a link by p.getDynamicsInfo, and (its centre of mass, the orientation of its inertial frame). The
// inverse of the inertial frame's local pose leads to the link's frame. pybullet returns no valid local pose
// for bodies with maximal coordinates (body type 1). Both frames of these are the same.
void place(Link& l, PyObject* info, PyObject* where) {
  PyObject *centre = item(where, 0), *turn = item(where, 1);
  const bool maximal = number(info, 10) == 1;
  const Rot3 local = maximal ? Rot3{} : turn_of(item(info, 4));
  l.pose.rotation = turn_of(turn) * transposed(local);
  l.centre = vector(centre);
  l.pose.origin = l.centre - (maximal ? Vec3{} : l.pose.rotation * vector(item(info, 3)));
}

// Takes its friction from p.getDynamicsInfo. Tendons that rest on it feel that this changes.
void take_friction(Link& l, PyObject* info) {
  const double friction = number(info, 1);
  l.moved |= friction != l.friction;
  l.friction = friction;
}

// Keeps where pybullet has a link, by its centre of mass and the orientation of its inertial frame, if
// pybullet's step does not move it: pybullet moves bases without mass by their velocity, too.
void note_standing(World& w, int slot, PyObject* where) {
  w.standing.resize(w.scene.links.size());
  w.standing[slot].reset();
  if (!w.scene.links[slot].rests()) return;
  double* out = w.standing[slot].emplace().data();
  for (int part = 0; part < 2; ++part)
    for (int i = 0; i < 3 + part; ++i) *out++ = number(item(where, part), i);
}

// Marks the link as one that tendons do not move.
void stand_still(World& w, int slot) {
  w.scene.links[slot].body = -1;
  w.scene.links[slot].jacobian.clear();
  if (w.scene.bodies[slot].n() > 0) w.scene.bodies[slot] = GeneralizedBody{};
}

// Whether all numbers of a link and its body are finite.
bool is_finite(const World& w, int slot) {
  const Link& l = w.scene.links[slot];
  const Vec3 sum = l.pose.origin + l.centre + l.rates.linear + l.rates.angular + l.pose.rotation.r0 +
                   l.pose.rotation.r1 + l.pose.rotation.r2;
  bool well = max_abs(0 * sum) == 0;
  for (const dense::Numbers* numbers : {&w.scene.bodies[slot].rates, &w.scene.bodies[slot].free})
    for (double v : *numbers) well &= std::fabs(v) <= std::numeric_limits<double>::max();
  return well;
}

Inertia inertia_of(Vec3 principal, const Rot3& axes) {
  const double moments[] = {principal.x, principal.y, principal.z};
  const auto [least, most] = std::minmax_element(moments, moments + 3);
  if (!(*least > 0)) return {};
  const bool slender = *least < kSlender * *most;
  return {turned(axes, principal), axes,
          slender ? axes * unit_axis(static_cast<int>(least - moments)) : Vec3{}};
}

// A rigid body by itself: inverse mass, and inverse inertia in world axes, zero where it has none.
void stand_alone(GeneralizedBody& m, const Link& l, PyObject* info, PyObject* turn, bool falls) {
  if (m.n() != 6) m = GeneralizedBody{};
  const Vec3 v = l.rates.linear, w = l.rates.angular, inertia = vector(item(info, 2));
  const Vec3 before = m.rates.size() == 6 ? Vec3{m.rates[3], m.rates[4], m.rates[5]} : w;
  m.rates.assign({v.x, v.y, v.z, w.x, w.y, w.z});
  m.external.clear();
  const Rot3 axes = turn_of(turn);
  m.inertia = falls ? inertia_of(inertia, axes) : Inertia{};
  m.history.possible = falls && !m.inertia.is_slender();
  m.stops.limits.clear();
  m.stops.constraints.clear();
  m.gravity_response.clear();
  if (falls) m.gravity_response.assign({1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0});
  auto inverse = [](double moment) { return moment > 0 ? 1 / moment : 0; };
  const Sym3 turning = turned(axes, {inverse(inertia.x), inverse(inertia.y), inverse(inertia.z)});
  m.by_motion.assign(6, 0.0);
  m.motion_shift.clear();
  const Sym3& moments = m.inertia.moments;
  if (trace(moments) > 0) {
    const Vec3 gyroscopic = -(turning * cross(w, moments * w));
    m.by_motion = {0, 0, 0, gyroscopic.x, gyroscopic.y, gyroscopic.z};
    const Vec3 now = 1.5 * w - 0.5 * before, shift = cross(w, moments * w) - cross(now, moments * now);
    m.motion_shift = {0, 0, 0, shift.x, shift.y, shift.z};
  }
  const Mat3 of_spin = full(turning);
  m.free.assign(36, 0.0);
  for (int i = 0; i < 3; ++i) {
    m.free[7 * i] = 1 / number(info, 0);
    for (int j = 0; j < 3; ++j) m.free[6 * (3 + i) + 3 + j] = of_spin.entry(i, j);
  }
}

// A link by p.getDynamicsInfo, (centre of mass, orientation of the inertial frame) and (velocity, spin);
// alone: it moves with its own mass, if it has one; falls: gravity acts on it. Returns 0 if a number is not
// finite, 2 if its contacts are needed (set_contacts), else 1.
int read_link(World& w, int slot, const py::tuple& info, const py::tuple& where, const py::tuple& motion,
              bool alone, bool falls) {
  w.ensure_link(slot);
  Link& l = w.scene.links[slot];
  place(l, info.ptr(), where.ptr());
  take_friction(l, info.ptr());
  l.rates.linear = vector(item(motion.ptr(), 0));
  l.rates.angular = vector(item(motion.ptr(), 1));
  const bool moves = alone && number(info.ptr(), 0) > 0;
  if (!moves) stand_still(w, slot);
  if (moves) l.body = slot;
  note_standing(w, slot, where.ptr());
  if (!moves) return is_finite(w, slot) ? 1 : 0;
  l.jacobian.clear();
  stand_alone(w.scene.bodies[slot], l, info.ptr(), item(where.ptr(), 1), falls);
  if (!is_finite(w, slot)) return 0;
  GeneralizedBody& m = w.scene.bodies[slot];
  if (m.stops.contacts_known) return 1;
  m.stops.contacts.clear();
  return falls ? 2 : 1;
}

// Takes its velocity and spin right after a step. Returns whether it was released.
bool sample_link(World& w, int slot, const py::tuple& motion) {
  const Vec3 v = vector(item(motion.ptr(), 0)), s = vector(item(motion.ptr(), 1));
  return w.scene.bodies[slot].sample({v.x, v.y, v.z, s.x, s.y, s.z}, {});
}

using Links = std::vector<std::pair<int, int>>;

// Sets the contacts of a body with the links `immovable` from p.getContactPoints: the normal towards the
// body, its moment about the centre of mass, and the distance. keep: use them for the next step, whatever
// pybullet reports then. A body that was never read has no contacts.
void set_contacts(World& w, int slot, const py::tuple& points, const Links& immovable, Vec3 centre,
                  bool keep) {
  if (slot >= static_cast<int>(w.scene.bodies.size()) || w.scene.bodies[slot].n() == 0) return;
  GeneralizedBody& m = w.scene.bodies[slot];
  if (keep && m.stops.contacts_known) return;
  m.stops.contacts.clear();
  m.stops.contacts_known = keep;
  for (const py::handle& point : points) {
    const std::pair<int, int> other{static_cast<int>(number(point.ptr(), 2)),
                                    static_cast<int>(number(point.ptr(), 4))};
    if (std::find(immovable.begin(), immovable.end(), other) == immovable.end()) continue;
    const Vec3 n = vector(item(point.ptr(), 7)), turn = cross(vector(item(point.ptr(), 5)) - centre, n);
    const double row[8] = {n.x, n.y, n.z, turn.x, turn.y, turn.z, number(point.ptr(), 8), 0};
    m.stops.contacts.insert(m.stops.contacts.end(), row, row + 8);
  }
}

// Two links that touch (-1: what the body does not move), with the coefficient of friction, and
// p.getContactPoints of the first one with the second one.
class Touching {
 public:
  Touching(const Articulated& tree, PyObject* pair)
      : points(item(pair, 3)), friction(number(pair, 2)), n_(tree.dofs()) {
    for (int side = 0; side < 2; ++side) {
      const int link = static_cast<int>(number(pair, side));
      if (link >= tree.links()) throw py::index_error("pairs");
      if (link < 0 || !tree.moves(link)) continue;
      sides_.push_back({tree.centre(link), dense::Numbers(6 * n_), side == 0 ? 1.0 : -1.0});
      tree.jacobian(link, sides_.back().jacobian.data());
    }
  }

  // Adds the row of a relative velocity along d, at the point p, or of a relative spin about it. of_row: what
  // else the row has.
  void add_row(Vec3 d, const Vec3* p, std::initializer_list<double> of_row, Numbers& rows) const {
    dense::Numbers row(n_);
    for (const Side& side : sides_) {
      const Vec3 linear = side.sign * (p ? d : Vec3{});
      const Vec3 angular = side.sign * (p ? cross(*p - side.centre, d) : d);
      const double along[6] = {linear.x, linear.y, linear.z, angular.x, angular.y, angular.z};
      dense::add_rows(side.jacobian, 6, along, row);
    }
    rows.insert(rows.end(), row.begin(), row.end());
    rows.insert(rows.end(), of_row);
  }

  PyObject* points;
  double friction;

 private:
  struct Side {
    Vec3 centre;
    dense::Numbers jacobian;  // (6 n)
    double sign;
  };
  int n_;
  std::vector<Side> sides_;
};

// Adds the rows of the contact points of two links, and those of their friction: at the middle of the
// forces of the last step, along two directions and about the normal. index: of the pair.
void add_touching(const Touching& pair, double index, Numbers& contacts, Numbers& frictions) {
  Vec3 normal, middle;
  double force = 0, arms = 0;
  std::vector<std::pair<Vec3, double>> pushes;  // places and forces
  for (int k = 0; k < PyTuple_Size(pair.points); ++k) {
    PyObject* point = item(pair.points, k);
    const Vec3 along = vector(item(point, 7)), at = vector(item(point, 5));
    pair.add_row(along, &at, {number(point, 8), index}, contacts);
    pushes.push_back({at, number(point, 9)});
    force += pushes.back().second;
    normal += pushes.back().second * along;
    middle += pushes.back().second * at;
  }
  if (!(force > 0)) return;
  middle = (1 / force) * middle;
  for (const auto& [at, push] : pushes) arms += push * norm(at - middle);
  normal = unit_or(normal, {0, 0, 1});
  const Vec3 first = direction_across(std::fabs(normal.x) < 0.5 ? Vec3{1, 0, 0} : Vec3{0, 1, 0}, normal);
  for (const Vec3 along : {first, cross(normal, first)})
    pair.add_row(along, &middle, {pair.friction * force, pair.friction, index}, frictions);
  pair.add_row(normal, nullptr, {pair.friction * arms, pair.friction * arms / force, index}, frictions);
}

// Sets the contacts among the links of a body, and with bodies without mass: both links, friction and points
// each. tree: as it was read. keep: as in set_contacts.
void set_touching(World& w, int slot, const Articulated& tree, const py::list& pairs, bool keep) {
  if (slot >= static_cast<int>(w.scene.bodies.size())) return;
  GeneralizedBody& m = w.scene.bodies[slot];
  if (m.n() != tree.dofs() || m.stops.contacts_known) return;
  m.stops.contacts.clear();
  m.stops.frictions.clear();
  m.stops.contacts_known = keep;
  double index = 0;
  for (const py::handle& pair : pairs)
    add_touching(Touching(tree, pair.ptr()), index++, m.stops.contacts, m.stops.frictions);
}

// A force of the user at a world point of the link that a slot stands for, in this step.
void add_link_force(World& w, int slot, Vec3 force, Vec3 point) {
  const Link& l = w.scene.links[slot];
  if (!l.yields()) return;
  const Vec3 torque = cross(point - l.centre, force);
  w.scene.bodies[slot].add_external({force.x, force.y, force.z, torque.x, torque.y, torque.z});
}

void clear_link(World& w, int slot) {
  w.ensure_link(slot);
  w.scene.links[slot] = Link{};
  w.scene.bodies[slot] = GeneralizedBody{};
  w.standing.resize(w.scene.links.size());
  w.standing[slot].reset();
  w.scene.filter.forget_link(slot);
}

// Forgets what was learned of the body in a slot.
void forget_body(World& w, int slot) {
  if (slot < static_cast<int>(w.scene.bodies.size())) w.scene.bodies[slot] = GeneralizedBody{};
}

// What pybullet returns about the bodies of a tree each: p.getDynamicsInfo of all links, in the order of the
// trees' links, (p.getBasePositionAndOrientation, p.getBaseVelocity) of each base, and
// p.getJointStatesMultiDof of the joints that move.
struct Reading {
  py::list infos, bases;
  py::tuple joints;
  PyObject* place_of(int tree) const { return item(PyList_GET_ITEM(bases.ptr(), tree), 0); }
  PyObject* motion_of(int tree) const { return item(PyList_GET_ITEM(bases.ptr(), tree), 1); }
};

void take(PyObject* from, int count, std::vector<double>& numbers) {
  for (int i = 0; i < count; ++i) numbers.push_back(number(from, i));
}

void place(Articulated& body, const Reading& reading, const std::vector<double>& places) {
  if (static_cast<int>(reading.infos.size()) != body.links()) throw py::value_error("infos");
  std::vector<LinkInertia> inertias;
  std::vector<double> bases;
  for (const py::handle& of : reading.infos) {
    PyObject* info = of.ptr();
    inertias.push_back(
        {number(info, 0), vector(item(info, 2)), vector(item(info, 3)), turn_of(item(info, 4))});
  }
  for (int tree = 0; tree < body.trees(); ++tree)
    for (int part = 0; part < 2; ++part) take(item(reading.place_of(tree), part), 3 + part, bases);
  body.place(inertias, bases.data(), places.data());
}

// The rates of the degrees of freedom, and where the joints are.
void read_joints(const Articulated& body, const Reading& reading, std::vector<double>& rates,
                 std::vector<double>& places) {
  const py::tuple& joints = reading.joints;
  if (static_cast<int>(reading.bases.size()) != body.trees()) throw py::value_error("bases");
  rates.clear();
  places.clear();
  for (int tree = 0; tree < body.trees(); ++tree)
    for (int part = 0; part < 2 && body.floats(tree); ++part)
      take(item(reading.motion_of(tree), part), 3, rates);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    PyObject* state = item(joints.ptr(), static_cast<int>(j));
    PyObject *place = item(state, 0), *rate = item(state, 1);
    take(place, static_cast<int>(PyTuple_Size(place)), places);
    take(rate, static_cast<int>(PyTuple_Size(rate)), rates);
  }
  if (static_cast<int>(rates.size()) != body.dofs() || static_cast<int>(places.size()) != body.places())
    throw py::value_error("joints");
}

// Places the body as it was read. Returns the rates of its degrees of freedom.
std::vector<double> place_as_read(Articulated& body, const Reading& reading) {
  std::vector<double> rates, places;
  read_joints(body, reading, rates, places);
  place(body, reading, places);
  return rates;
}

// The forces of the motors of joints with one degree of freedom: those of others are in frames of pybullet's
// own.
void read_motors(const Articulated& body, const py::tuple& joints, std::vector<double>& motors) {
  motors.assign(body.rates_of_bases(), 0.0);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    PyObject* force = item(item(joints.ptr(), static_cast<int>(j)), 3);
    const int count = static_cast<int>(PyTuple_Size(item(item(joints.ptr(), static_cast<int>(j)), 1)));
    if (count == 1)
      take(force, 1, motors);
    else
      motors.insert(motors.end(), count, 0.0);
  }
}

// Sets what the forces of the motion at the velocity now differ by from those at the mean velocity of the
// last step. before: that of the step before it (dofs). Damping of joints stays explicit.
void find_motion_shift(GeneralizedBody& m, const Articulated& body, const dense::Numbers& before) {
  const std::size_t n = m.rates.size();
  m.motion_shift.assign(n, 0.0);
  if (before.size() != n) return;
  dense::Numbers now(n), behind(n);
  for (std::size_t i = 0; i < n; ++i) now[i] = 1.5 * m.rates[i] - 0.5 * before[i];
  body.inertial_force(now.data(), m.motion_shift.data());
  body.inertial_force(m.rates.data(), behind.data());
  dense::add(m.motion_shift, -1, behind);
}

// continues: BDF2 may continue its motion.
void read_dynamics(GeneralizedBody& m, Articulated& body, const Reading& reading, bool continues) {
  const std::size_t n = body.dofs();
  std::vector<double> places, mass(n * n), weight(3 * n);
  const dense::Numbers before(m.rates);
  read_joints(body, reading, m.rates, places);
  read_motors(body, reading.joints, m.stops.motors.reports);
  if (!m.stops.motors.reported_known) m.stops.motors.reported = m.stops.motors.reports;
  place(body, reading, places);
  body.mass_matrix(mass.data());
  body.weight(weight.data());
  dense::set_identity(static_cast<int>(n), m.free);
  answer(static_cast<int>(n), static_cast<int>(n), mass.data(), m.free.data());
  m.gravity_response.assign(3 * n, 0.0);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t k = 0; k < n; ++k)
      for (std::size_t e = 0; e < 3; ++e)
        m.gravity_response[3 * i + e] += m.free[i * n + k] * weight[3 * k + e];
  std::vector<double> moving(n);
  body.velocity_force(m.rates.data(), moving.data());
  dense::multiply(m.free, moving, m.by_motion);
  body.limits(places.data(), m.stops.limits);
  if (continues)
    find_motion_shift(m, body, before);
  else
    m.motion_shift.clear();
}

// Sets velocity and spin of a link from the rates, and from the motion of a base that is not floating.
void set_motion(Link& l, int tree, const Articulated& body, const Reading& reading,
                const std::vector<double>& rates) {
  l.rates = {};
  if (!body.floats(tree)) {
    PyObject *motion = reading.motion_of(tree), *base = reading.place_of(tree);
    const Vec3 spin = vector(item(motion, 1));
    l.rates.linear = vector(item(motion, 0)) + cross(spin, l.centre - vector(item(base, 0)));
    l.rates.angular = spin;
  }
  if (l.jacobian.empty()) return;
  std::vector<double> twist;
  dense::multiply(l.jacobian, rates, twist);
  l.rates.linear += Vec3{twist[0], twist[1], twist[2]};
  l.rates.angular += Vec3{twist[3], twist[4], twist[5]};
}

// An end of a constraint: link, coordinate, and of the frame origin 3, axes 4, velocity 3, spin 3.
ConstraintEnd constraint_end(PyObject* of) {
  ConstraintEnd end;
  end.link = static_cast<int>(number(of, 0));
  end.coordinate = static_cast<int>(number(of, 1));
  end.frame = {turn_of(item(of, 3)), vector(item(of, 2))};
  end.velocity = vector(item(of, 4));
  end.spin = vector(item(of, 5));
  return end;
}

// Constraints: (kind, most, ratio, end, end) each.
std::vector<LinkConstraint> constraints_of(const py::list& constraints, int links, int rates) {
  std::vector<LinkConstraint> found;
  for (const py::handle& of : constraints) {
    PyObject* from = of.ptr();
    const auto kind = static_cast<ConstraintKind>(static_cast<int>(number(from, 0)));
    found.push_back({kind, constraint_end(item(from, 3)), constraint_end(item(from, 4)),
                     std::min(number(from, 1), kUnlimited), number(from, 2)});
    for (const ConstraintEnd* end : {&found.back().a, &found.back().b})
      if (end->link >= links || end->coordinate >= rates ||
          (kind == ConstraintKind::gear && end->coordinate < 0))
        throw py::index_error("constraints");
  }
  return found;
}

void set_body_constraints(GeneralizedBody& m, const Articulated& body, const py::list& constraints) {
  m.stops.constraints.clear();
  for (const LinkConstraint& c : constraints_of(constraints, body.links(), m.n()))
    add_constraint_rows(
        c, m.n(),
        [&](int link) {
          ConstrainedLink at{body.inertial_frame(link), dense::Numbers(6 * m.n())};
          body.jacobian(link, at.jacobian.data());
          return at;
        },
        m.stops.constraints);
}

// Constraints of a rigid body, which is link 0, with what it does not move. where: as in read_link.
void set_link_constraints(World& w, int slot, const py::list& constraints, const py::tuple& where) {
  GeneralizedBody& m = w.scene.bodies[slot];
  if (m.n() != 6) return;
  ConstrainedLink link{{turn_of(item(where.ptr(), 1)), vector(item(where.ptr(), 0))}, {}};
  dense::set_identity(6, link.jacobian);
  for (const LinkConstraint& c : constraints_of(constraints, 1, 6))
    add_constraint_rows(c, 6, [&](int) { return link; }, m.stops.constraints);
}

// Reads the links of one body. The first slot holds its GeneralizedBody. Returns false if a number is not
// finite.
bool read_body(World& w, Articulated& body, const std::vector<int>& slots, const std::vector<int>& links,
               const py::list& infos, const py::list& bases, const py::tuple& joints,
               const py::list& constraints) {
  const Reading reading{infos, bases, joints};
  for (int slot : slots) w.ensure_link(slot);
  GeneralizedBody& m = w.scene.bodies[slots[0]];
  if (m.n() != body.dofs()) m = GeneralizedBody{};
  m.external.clear();
  m.inertia = {};
  m.history.possible = true;
  const bool continues = is_second_order(w.options.integrator);
  read_dynamics(m, body, reading, continues);
  set_body_constraints(m, body, constraints);
  for (std::size_t i = 0; i < slots.size(); ++i) {
    const int link = links[i];
    Link& l = w.scene.links[slots[i]];
    l.centre = body.centre(link);
    l.pose = body.frame(link);
    take_friction(l, infos[link].ptr());
    if (i > 0) stand_still(w, slots[i]);
    l.body = body.moves(link) ? slots[0] : -1;
    l.jacobian.assign(body.moves(link) ? 6 * m.n() : 0, 0.0);
    if (body.moves(link)) body.jacobian(link, l.jacobian.data());
    const int tree = body.tree_of(link);
    set_motion(l, tree, body, reading, m.rates);
    if (link == tree) note_standing(w, slots[i], reading.place_of(tree));
  }
  std::vector<Vec3> curvings;
  body.curvings(m.rates.data(), curvings);
  for (std::size_t i = 0; i < slots.size(); ++i) w.scene.links[slots[i]].curving = curvings[links[i]];
  return std::all_of(slots.begin(), slots.end(), [&](int slot) { return is_finite(w, slot); });
}

// Takes its rates right after a step. bases: as in read_body. Returns whether it was released.
bool sample_body(World& w, int slot, const Articulated& body, const py::list& bases,
                 const py::tuple& joints) {
  std::vector<double> rates, places, motors;
  read_joints(body, Reading{py::list(), bases, joints}, rates, places);
  read_motors(body, joints, motors);
  return w.scene.bodies[slot].sample(rates, motors);
}

// Takes the forces of its motors into the state that is going to be saved.
void keep_motors(World& w, int slot, const Articulated& body, const py::tuple& joints) {
  GeneralizedBody& m = w.scene.bodies[slot];
  if (m.stops.motors.reported_known || m.n() != body.dofs()) return;
  read_motors(body, joints, m.stops.motors.reported);
  m.stops.motors.reported_known = true;
}

// A force of the user at a world point of any link of a body, in this step. tree: as it was read.
void add_body_force(World& w, int slot, const Articulated& tree, int link, Vec3 force, Vec3 point) {
  GeneralizedBody& m = w.scene.bodies[slot];
  if (m.n() != tree.dofs() || link < 0 || link >= tree.links() || !tree.moves(link)) return;
  dense::Numbers jacobian(6 * m.n()), generalized(m.n());
  tree.jacobian(link, jacobian.data());
  const Vec3 torque = cross(point - tree.centre(link), force);
  const double wrench[6] = {force.x, force.y, force.z, torque.x, torque.y, torque.z};
  dense::add_rows(jacobian, 6, wrench, generalized);
  m.add_external(generalized);
}

// A force or torque of the user on a degree of freedom of a body, in this step. tree: as it was read.
void add_joint_force(World& w, int slot, const Articulated& tree, int dof, double force) {
  GeneralizedBody& m = w.scene.bodies[slot];
  if (m.n() != tree.dofs() || dof < 0 || dof >= m.n()) return;
  dense::Numbers generalized(m.n());
  generalized[dof] = force;
  m.add_external(generalized);
}

// J (links, 6, dofs), the mass matrix, and the generalized force of the motion itself (dofs).
py::tuple dynamics(Articulated& body, const py::list& infos, const py::list& bases, const py::tuple& joints,
                   const py::list& chosen) {
  const std::vector<double> rates = place_as_read(body, {infos, bases, joints});
  const py::ssize_t n = body.dofs(), count = chosen.size();
  Array jacobians({count, py::ssize_t{6}, n}), mass({n, n});
  for (py::ssize_t i = 0; i < count; ++i) {
    const int link = chosen[i].cast<int>();
    if (link < 0 || link >= body.links()) throw py::index_error("links");
    body.jacobian(link, jacobians.mutable_data() + 6 * n * i);
  }
  body.mass_matrix(mass.mutable_data());
  Array moving(n);
  body.velocity_force(rates.data(), moving.mutable_data());
  return py::make_tuple(jacobians, mass, moving);
}

// Impulses (m) of rows that lack the rates left (m) without them, with within (m m) and bounds (m), solved or
// swept as by pybullet. A row without a lower bound of 0 is a motor of a joint of its own.
Numbers bounded_impulses(const Numbers& within, const Numbers& left, const Numbers& least,
                         const Numbers& most, bool swept) {
  const std::size_t m = left.size();
  if (within.size() != m * m || least.size() != m || most.size() != m) throw py::value_error("rows");
  Numbers whole(m), pushes(m);
  std::vector<Stop> rows(m);
  for (std::size_t a = 0; a < m; ++a) {
    rows[a].least = least[a];
    rows[a].most = std::min(most[a], kUnlimited);
    rows[a].motor = least[a] < 0;
    rows[a].coordinate = static_cast<int>(a);
    whole[a] = std::fabs(left[a]);
  }
  const BoundedRows bounded(rows, within, left, whole, 1);
  if (swept)
    bounded.sweep_as_pybullet(pushes, pushes);
  else
    bounded.solve(pushes);
  return pushes;
}

// Articulated bodies.

// By joint: kind, parent, axis (3), pivot (3), turn (quaternion 4, of the parent's frame in the link's),
// limits (2), damping.
// floating: by tree.
Articulated articulated(const Ints& kinds, const Ints& parents, const Array& numbers,
                        const std::vector<bool>& floating) {
  std::vector<Joint> joints;
  for (py::ssize_t j = 0; j < kinds.size(); ++j) {
    const auto kind = static_cast<JointKind>(kinds.data()[j]);
    const double* p = numbers.data() + 13 * j;
    joints.push_back(
        {kind, parents.data()[j], vec(p), vec(p + 3), transposed(rotation_of(p + 6)), p[10], p[11], p[12]});
  }
  return {joints, floating};
}

Array answer_of(const Array& mass, const Array& forces) {
  Array out({forces.shape(0), forces.shape(1)});
  std::copy(forces.data(), forces.data() + forces.size(), out.mutable_data());
  answer(static_cast<int>(forces.shape(0)), static_cast<int>(forces.shape(1)), mass.data(),
         out.mutable_data());
  return out;
}

// (links, 6)
std::vector<std::array<double, 6>> wrenches(const World& w, Wrench Link::* which) {
  std::vector<std::array<double, 6>> out;
  for (const Link& l : w.scene.links) {
    const Vec3 f = (l.*which).force, t = (l.*which).torque;
    out.push_back({f.x, f.y, f.z, t.x, t.y, t.z});
  }
  return out;
}

// What pybullet is given on a link: the wrench of the tendons, and on a rigid body what else it is given.
Wrench push_on(const World& w, const Link& l) {
  const dense::Numbers& f = w.scene.bodies[l.body].joint_forces;
  if (!l.jacobian.empty() || f.size() != 6) return l.wrench;
  return l.wrench + Wrench{{f[0], f[1], f[2]}, {f[3], f[4], f[5]}};
}

// Jacobian of a link (6, n), and response of its body (n, n) with the stops that acted in the last step.
py::tuple response_of(const World& w, int link) {
  const Link& l = w.scene.links[link];
  const GeneralizedBody& body = w.scene.bodies[l.body];
  const py::ssize_t n = body.n();
  Array jacobian({py::ssize_t{6}, n}), response({n, n});
  dense::Numbers stopped(body.free);
  if (body.stops.act()) dense::product_transposed(body.n(), body.root, body.root, stopped);
  std::copy(stopped.begin(), stopped.end(), response.mutable_data());
  std::copy(l.jacobian.begin(), l.jacobian.end(), jacobian.mutable_data());
  if (l.jacobian.empty())
    for (py::ssize_t k = 0; k < 6 * n; ++k) jacobian.mutable_data()[k] = k % (n + 1) == 0;
  return py::make_tuple(jacobian, response);
}

// Slot, force, point and torque about the point of every link that yields and is given a wrench. The torque
// is None where the wrench is a single force, as from one attachment: where both are orthogonal.
py::list pushes(const World& w) {
  py::list out;
  for (std::size_t i = 0; i < w.scene.links.size(); ++i) {
    const Link& l = w.scene.links[i];
    if (!l.yields()) continue;
    const Wrench push = push_on(w, l);
    const double force = norm(push.force), torque = norm(push.torque);
    if (!(force > 0 || torque > 0)) continue;
    if (std::fabs(dot(push.force, push.torque)) <= kRoundingShare * force * torque && force > 0) {
      // Of unit vectors: the product of tiny forces and torques would underflow.
      const Vec3 arm = (torque / force) * cross(unit_or(push.force, {}), unit_or(push.torque, {}));
      const Vec3 point = l.start.centre + arm;
      out.append(py::make_tuple(i, push.force, point, py::none()));
    } else {
      out.append(py::make_tuple(i, push.force, l.start.centre, push.torque));
    }
  }
  return out;
}

// Whether any body may have been released in the last step.
bool any_held(const World& w) {
  return std::any_of(w.scene.bodies.begin(), w.scene.bodies.end(),
                     [](const GeneralizedBody& m) { return m.may_be_released(); });
}

}  // namespace

void bind_bodies(py::module_& m, GuardedWorld& world) {
  m.attr("HINGE") = static_cast<int>(JointKind::hinge);
  m.attr("SLIDER") = static_cast<int>(JointKind::slider);
  m.attr("BALL") = static_cast<int>(JointKind::ball);
  m.attr("FIXED") = static_cast<int>(JointKind::fixed);
  m.attr("POINT_CONSTRAINT") = static_cast<int>(ConstraintKind::point);
  m.attr("FIXED_CONSTRAINT") = static_cast<int>(ConstraintKind::fixed);
  m.attr("GEAR_CONSTRAINT") = static_cast<int>(ConstraintKind::gear);
  py::class_<Articulated>(m, "Articulated")
      .def(py::init(&articulated))
      .def("copy", [](const Articulated& body) { return Articulated(body); })
      .def_property_readonly("links", &Articulated::links)
      .def_property_readonly("trees", &Articulated::trees)
      .def_property_readonly("dofs", &Articulated::dofs)
      .def("moves", &Articulated::moves);
  m.def("answer", &answer_of);
  world.def("clear_link", &clear_link)
      .def("forget_body", &forget_body)
      .def("read_link", &read_link)
      .def("sample_link", &sample_link)
      .def("set_contacts", &set_contacts)
      .def("set_touching", &set_touching)
      .def("keep_touching",
           [](World& w, const std::vector<int>& bodies) {
             if (w.touching_known) return;
             w.touching = bodies;
             w.touching_known = true;
           })
      .def("kept_touching",
           [](World& w) -> std::optional<std::vector<int>> {
             if (!std::exchange(w.touching_known, false)) return {};
             return w.touching;
           })
      .def("add_link_force", &add_link_force);
  m.def("link_frame", [](const py::tuple& info, const py::tuple& where) {
    Link l;
    place(l, info.ptr(), where.ptr());
    const Vec3 o = l.pose.origin;
    return py::make_tuple(std::vector<double>{o.x, o.y, o.z}, l.pose.rotation);
  });
  m.def("bounded_impulses", &bounded_impulses);
  world.def("read_body", &read_body)
      .def("set_link_constraints", &set_link_constraints)
      .def("sample_body", &sample_body)
      .def("keep_motors", &keep_motors)
      .def("add_body_force", &add_body_force)
      .def("add_joint_force", &add_joint_force);
  m.def("dynamics", &dynamics);
  m.def("place_body", [](Articulated& tree, const py::list& infos, const py::list& bases,
                         const py::tuple& joints) { place_as_read(tree, {infos, bases, joints}); });
  world
      .def("sense",
           [](World& w, double dt, Vec3 gravity) {
             w.sense(dt, gravity, false);
             return any_held(w) || !w.released_bodies().empty() || !w.pulled_bodies().empty();
           })
      .def("released_bodies", &World::released_bodies)
      .def("rewind", &World::rewind)
      .def("accept_resolve", &World::accept_resolve)
      .def("pulled_bodies", &World::pulled_bodies)
      .def("any_held", &any_held)
      .def("held_bodies",
           [](const World& w) {
             return slots_where(w.scene.bodies, [](const GeneralizedBody& m) {
               return m.may_be_released() && !m.released();
             });
           })
      .def("let_go", &World::let_go)
      .def("has_motors",
           [](const World& w, int body) { return w.scene.bodies[body].stops.motors.any_reported(); })
      .def("missed", [](const World& w, int body) { return w.scene.bodies[body].observer.missed(); })
      .def("velocity_was_cut",
           [](const World& w, int body) { return w.scene.bodies[body].observer.velocity_was_cut(); })
      .def("response", &response_of)
      .def("thrown_bodies",
           [](const World& w) {
             return slots_where(w.scene.bodies,
                                [](const GeneralizedBody& m) { return m.released_at_limit(); });
           })
      .def("rates_at_end",
           [](World& w, int body) { return w.scene.bodies[body].rates_at_end(w.last_step().dt); })
      .def("pushable",
           [](const World& w) {
             return slots_where(w.scene.links, [&](const Link& l) {
               return l.yields() && w.scene.bodies[l.body].observer.responds_freely();
             });
           })
      .def("joint_forces",
           [](const World& w, int body, const Articulated& tree) {
             py::list out;
             const dense::Numbers& forces = w.scene.bodies[body].joint_forces;
             for (size_t dof = 0; dof < forces.size(); ++dof) {
               if (forces[dof] == 0) continue;
               const Articulated::JointForce f = tree.force_of(static_cast<int>(dof), forces[dof]);
               out.append(py::make_tuple(f.link, f.parent, f.force, f.point, f.torque));
             }
             return out;
           })
      .def("limit_shifts",
           [](const World& w, int body, const Articulated& tree) {
             py::list out;
             const dense::Numbers& shifts = w.scene.bodies[body].stops.shifts;
             for (std::size_t s = 0; s < shifts.size(); s += 2)
               out.append(py::make_tuple(tree.force_of(static_cast<int>(shifts[s]), 0).link, shifts[s + 1]));
             return out;
           })
      .def("finish_resolve", &World::finish_resolve)
      .def("rest_bodies", &World::rest_bodies)
      .def("wrenches", [](const World& w) { return wrenches(w, &Link::wrench); })
      .def("wrenches_to_read", [](const World& w) { return wrenches(w, &Link::read); })
      .def("pushes", &pushes);
}

}  // namespace bt
