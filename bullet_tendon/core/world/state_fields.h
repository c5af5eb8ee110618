// All fields of a saved state: visit(archive, struct) for every saved struct gives the archive each field
// with its name.
//
// The order of the fields affects only the bytes. The hash of a field's name precedes it in the bytes, so
// that a reader rejects another layout and names the first field that differs.
#pragma once
#include "collision/collision_filter.h"
#include "collision/proximity_cache.h"
#include "world/checkpoint.h"

namespace bt {

// BT_FOR_EACH(macro, a, b, c) is macro(a) macro(b) macro(c). A macro does not expand within itself. Therefore
// the rest of the list waits for one of the 27 scans of BT_SCAN.
#define BT_SCAN(...) BT_SCAN_9(BT_SCAN_9(BT_SCAN_9(__VA_ARGS__)))
#define BT_SCAN_9(...) BT_SCAN_3(BT_SCAN_3(BT_SCAN_3(__VA_ARGS__)))
#define BT_SCAN_3(...) BT_SCAN_1(BT_SCAN_1(BT_SCAN_1(__VA_ARGS__)))
#define BT_SCAN_1(...) __VA_ARGS__
#define BT_NOTHING ()
#define BT_FOR_EACH(macro, ...) BT_SCAN(BT_FIRST(macro, __VA_ARGS__))
#define BT_FIRST(macro, first, ...) macro(first) __VA_OPT__(BT_REST BT_NOTHING(macro, __VA_ARGS__))
#define BT_REST() BT_FIRST

#define BT_FIELD(member) archive(#member, object.member);
#define BT_FIELDS(Struct, ...)                       \
  template <class Archive>                           \
  static void of(Archive& archive, Struct& object) { \
    BT_FOR_EACH(BT_FIELD, __VA_ARGS__)               \
  }

// A struct, because some fields are private (friend).
struct StateFields {
  BT_FIELDS(Line, spring, rest, slip, most_force, slips, along, tension)
  BT_FIELDS(AnchorTarget, goal, aim, last_aim)
  BT_FIELDS(AnchorForce, total, mean, last_mean, sum, of_step, read, late)
  BT_FIELDS(Anchor, id, particle, link, local, is_line, rigid, clamped, direction, stiffness, viscosity,
            most_force, exact, slips, target, force, line)
  // Masses and spring constants are computed from these fields.
  BT_FIELDS(TendonModel, force, point_mass, rest)
  BT_FIELDS(Threaded, segment, tunnel)
  BT_FIELDS(TendonState, x, v, anchors, overlaid, tunnel_of, threaded, x_before, v_before, dt_before, smooth,
            with_body, mean_velocities, steady_share, quiet, sleeping_island, torn, touching, touched)
  BT_FIELDS(CollisionFilter, inert_, tendons_, links_)
  BT_FIELDS(SpringState, lambda, elastic, slope, unrelaxed, memory)
  BT_FIELDS(TendonCheckpoint, alive, state, structure, shear)
  BT_FIELDS(Stop, wanted, missing, held_back, unstopped, coordinate, acts, admitted, ahead, least, most, side,
            motor, friction, coefficient, pair, constraint, yielded, given)
  BT_FIELDS(JointMotor, aim, gained, trend, leap, foreseen, needed, force, limit, greatest, side, lets,
            solved, known)
  BT_FIELDS(BodyStops, all_, directions_, pushes_, unstopped_, doubted_, rested_, broke_, yielded_, ignored_,
            by_pybullet_, limits, contacts, frictions, contacts_known, shifts, motors.all, motors.again,
            motors.soft, motors.reported, motors.reported_known, motors.reported_before, motors.off,
            motors.thrown)
  BT_FIELDS(Observer::Sample, forces, acceleration, root_forces, root_acceleration, cut)
  BT_FIELDS(Observer, n_, root_, effective_root_, share_, share_root_, rates_, forces_, applied_, push_,
            last_, previous_, dt_, samples_, known_, acted_, released_, hold_.acts, hold_.yields,
            hold_.limit_known, hold_.firm, hold_.withstood, hold_.push, sampled_, axes_, axes_known_)
  BT_FIELDS(BodyHistory, possible, smooth, known, steady_share, dt)
  BT_FIELDS(GeneralizedBody, rates, free, gravity_response, inertia.moments, inertia.axes,
            inertia.slender_axis, by_motion, known_in_step_, external, stops, forces, observer, history, root,
            change, touches, turning.far, substep.pushed, left_out.owed, left_out.kept)
  BT_FIELDS(LinkStart, pose, centre, known)
  BT_FIELDS(Link, pose, centre, start, rates, drift_rates, friction, body, yielded, moved, put, jacobian,
            root, history.mean, history.applied, history.excess, wrench, read, late)
  BT_FIELDS(ContactKey, kind, tendon, feature, other, other_feature, end)
  BT_FIELDS(ContactMemory, key, lambda, lambda_confirmed, load, squeezed_gap, sliding, mean_force,
            given_force, h_eff, tangent_anchor, normal)
  BT_FIELDS(SegmentPoint, tendon, first, w0, w1)
  // Only what reports of the last step need, and what sleeping contacts need to act on links.
  BT_FIELDS(Contact, key, a, b, link, geometry.normal, geometry.depth_allowance, geometry.margin,
            geometry.gap, normal_force.value, friction.force, force.mean)
  BT_FIELDS(Plane, point, normal, u, hole)
  // The list of near triangles is recomputed from a, b and listed.
  BT_FIELDS(Entry, known, inside, distance, clearance, asked, a, b, listed)
  // What a world must share with a state to restore it. The surface of a mesh has a mark of its own.
  BT_FIELDS(Law, exponent, toe_strain, tension_only, damping_exponent, whole_velocity)
  BT_FIELDS(Material, law, stiffness, damping, shear_stiffness, bending_stiffness, linear_density, tissue)
  BT_FIELDS(Primitive, kind, half, growth, radius, half_length)
  BT_FIELDS(Shape, link, local, lo, hi, half_space, plane_normal, plane_offset, friction, primitive)
  BT_FIELDS(Tunnel, link, start, end, radius, chamfer, friction, start_slope, end_slope)
  BT_FIELDS(StepRecord, dt, gravity)
  BT_FIELDS(PathPoint, link, local)
  BT_FIELDS(Wrap, link, shape, local, radii)
  BT_FIELDS(LigamentModel, rest, tension)
  BT_FIELDS(Tissue, weights, times, most_force, most_strain)
  BT_FIELDS(LigamentState, force, unrelaxed, memory, begun, ruptured)
  BT_FIELDS(FoundationLaw, stiffness, thickness, logarithmic)
  BT_FIELDS(CartilageModel, law, damping)
  BT_FIELDS(PressedRegion, force, torque, area, centre, max_pressure, max_depth)
  BT_FIELDS(CartilageState, regions)
  BT_FIELDS(ElementCheckpoint, ligaments, cartilages)
  // The elements are stored beside the other fields, where there are any.
  BT_FIELDS(Checkpoint, valid, tendons, links, bodies, touching, touching_known, memory, contacts,
            sleeping_contacts, rest_gravity, last_step, may_resolve, sensed_links, sensed_bodies)
};

template <class Archive, class Struct>
void visit(Archive& archive, Struct& object) {
  StateFields::of(archive, object);
}

}  // namespace bt
