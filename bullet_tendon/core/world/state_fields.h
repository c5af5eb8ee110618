// All fields of a saved state, by name: visit(archive, struct) for every saved struct.
//
// The order of the fields affects only the bytes. The hash of a field's name precedes it in the bytes, so
// that a reader rejects another layout and names the first field that differs. A name is that of the
// member, except for members of nested structs.
#pragma once
#include "collision/proximity_cache.h"
#include "world/checkpoint.h"

namespace bt {

template <class A>
void visit(A& a, Anchor& h) {
  a("id", h.id);
  a("particle", h.particle);
  a("link", h.link);
  a("local", h.local);
  a("rigid", h.rigid);
  a("clamped", h.clamped);
  a("direction", h.direction);
  a("stiffness", h.stiffness);
  a("goal", h.goal);
  a("aim", h.aim);
  a("target_before", h.target_before);
  a("viscosity", h.viscosity);
  a("force", h.force);
  a("mean_force", h.mean_force);
  a("last_mean", h.last_mean);
  a("sum_force", h.sum_force);
  a("step_force", h.step_force);
}

// Masses and spring constants are computed from these fields.
template <class A>
void visit(A& a, TendonModel& m) {
  a("force", m.force);
  a("point_mass", m.point_mass);
  a("rest", m.rest);
}

template <class A>
void visit(A& a, TendonState& s) {
  a("x", s.x);
  a("v", s.v);
  a("anchors", s.anchors);
  a("overlaid", s.overlaid);
  a("tunnel_of", s.tunnel_of);
  a("x_before", s.x_before);
  a("v_before", s.v_before);
  a("dt_before", s.dt_before);
  a("smooth", s.smooth);
  a("quiet", s.quiet);
  a("sleeping_island", s.sleeping_island);
  a("touching", s.touching);
  a("touched", s.touched);
}

template <class A>
void visit(A& a, SpringState& s) {
  a("lambda", s.lambda);
  a("elastic", s.elastic);
  a("slope", s.slope);
}

template <class A>
void visit(A& a, TendonCheckpoint& t) {
  a("alive", t.alive);
  a("state", t.state);
  a("structure", t.structure);
  a("shear", t.shear);
}

template <class A>
void visit(A& a, Stop& s) {
  a("wanted", s.wanted);
  a("missing", s.missing);
  a("held_back", s.held_back);
  a("coordinate", s.coordinate);
  a("acts", s.acts);
}

struct StateFields {
  template <class A>
  static void of(A& a, Observer::Sample& s) {
    a("forces", s.forces);
    a("acceleration", s.acceleration);
    a("root_forces", s.root_forces);
    a("root_acceleration", s.root_acceleration);
    a("cut", s.cut);
  }
  template <class A>
  static void of(A& a, Observer& o) {
    a("n", o.n_);
    a("root", o.root_);
    a("effective_root", o.effective_root_);
    a("share", o.share_);
    a("share_root", o.share_root_);
    a("rates", o.rates_);
    a("forces", o.forces_);
    a("push", o.push_);
    of(a, o.last_);
    of(a, o.previous_);
    a("dt", o.dt_);
    a("samples", o.samples_);
    a("known", o.known_);
    a("acted", o.acted_);
    a("held", o.held_);
    a("released", o.released_);
    a("sampled", o.sampled_);
  }
  template <class A>
  static void of(A& a, GeneralizedBody& m) {
    a("rates", m.rates);
    a("free", m.free);
    a("gravity_response", m.gravity_response);
    a("velocity_response", m.velocity_response);
    a("velocity_acceleration", m.velocity_acceleration);
    a("limits", m.limits);
    a("contacts", m.contacts);
    a("contacts_known", m.contacts_known);
    of(a, m.observer);
    a("root", m.root);
    a("change", m.change);
    a("touches", m.touches);
    a("turns_far", m.turning.far);
    a("stopped_by", m.stopped_by_);
    a("stops", m.stops_);
    a("directions", m.directions_);
    a("pushes", m.pushes_);
    a("unstopped", m.unstopped_);
    a("pushed", m.pushed_);
    a("doubted", m.doubted_);
    a("rested", m.rested_);
    a("slipped", m.slipped_);
  }
};

template <class A>
void visit(A& a, GeneralizedBody& m) {
  StateFields::of(a, m);
}

template <class A>
void visit(A& a, Link& l) {
  a("pose", l.pose);
  a("centre", l.centre);
  a("start_pose", l.start_pose);
  a("start_centre", l.start_centre);
  a("now_velocity", l.now_velocity);
  a("now_spin", l.now_spin);
  a("velocity", l.velocity);
  a("spin", l.spin);
  a("body", l.body);
  a("yielded", l.yielded);
  a("moved", l.moved);
  a("jacobian", l.jacobian);
  a("root", l.root);
  a("force", l.wrench.force);
  a("torque", l.wrench.torque);
}

template <class A>
void visit(A& a, ContactKey& k) {
  a("kind", k.kind);
  a("tendon", k.tendon);
  a("feature", k.feature);
  a("other", k.other);
  a("other_feature", k.other_feature);
  a("end", k.end);
}

template <class A>
void visit(A& a, ContactMemory& m) {
  a("key", m.key);
  a("lambda", m.lambda);
  a("lambda_confirmed", m.lambda_confirmed);
  a("sliding", m.sliding);
  a("mean_force", m.mean_force);
  a("h_eff", m.h_eff);
  a("tangent_anchor", m.tangent_anchor);
}

template <class A>
void visit(A& a, SegmentPoint& s) {
  a("tendon", s.tendon);
  a("first", s.first);
  a("w0", s.w0);
  a("w1", s.w1);
}

// Only what reports of the last step need, and what sleeping contacts need to act on links.
template <class A>
void visit(A& a, Contact& r) {
  a("key", r.key);
  a("a", r.a);
  a("b", r.b);
  a("link", r.link);
  a("normal", r.geometry.normal);
  a("depth_allowance", r.geometry.depth_allowance);
  a("margin", r.geometry.margin);
  a("gap", r.geometry.gap);
  a("normal_force", r.normal_force.value);
  a("friction_force", r.friction.force);
  a("mean_force", r.force.mean);
}

template <class A>
void visit(A& a, Plane& p) {
  a("point", p.point);
  a("normal", p.normal);
  a("u", p.u);
  a("hole", p.hole);
}

// The list of near triangles is recomputed from a, b and listed.
template <class A>
void visit(A& a, Entry& e) {
  a("known", e.known);
  a("inside", e.inside);
  a("distance", e.distance);
  a("clearance", e.clearance);
  a("age", e.age);
  a("asked", e.asked);
  a("a", e.a);
  a("b", e.b);
  a("listed", e.listed);
}

template <class A>
void visit(A& a, StepRecord& s) {
  a("dt", s.dt);
  a("gravity", s.gravity);
}

template <class A>
void visit(A& a, Checkpoint& c) {
  a("valid", c.valid);
  a("tendons", c.tendons);
  a("links", c.links);
  a("bodies", c.bodies);
  a("memory", c.memory);
  a("contacts", c.contacts);
  a("sleeping_contacts", c.sleeping_contacts);
  a("rest_gravity", c.rest_gravity);
  a("last_step", c.last_step);
  a("may_resolve", c.may_resolve);
  a("sensed_links", c.sensed_links);
  a("sensed_bodies", c.sensed_bodies);
}

}  // namespace bt
