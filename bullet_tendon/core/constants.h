// Every number that is a choice, with its unit, its reason, and what goes wrong when it is changed;
// those of the bodies that tendons move are in body_constants.h.
#pragma once
#include <cstddef>

namespace bt {

// A direction cannot be taken from a spring shorter than this share of its rest length [-].
// Larger: a collapsed tendon loses forces. Smaller: the direction is rounding noise.
constexpr double kDegenerateLength = 1e-9;

// Particles that are put closer together than that are spread by this share of the rest length [-].
constexpr double kSpread = 1e-6;

// Contact stiffness in units of what holds a particle back across its tendon: inertia and tension over
// length [-]. The contact force itself comes from carried multipliers, so this sets how fast depth
// vanishes, not how deep a resting contact is. Larger: active contacts are found in more iterations.
// Smaller: more rounds of stiffening after impacts.
constexpr double kContactRatio = 30.0;

// The same for the weights of two-step methods [-]. A force that is carried over lags behind the depth that
// it answers to, which feeds vibrations; the less so the stiffer, and two-step methods damp them hardly. At
// 30 what rests over an edge begins to vibrate; at 100 it does not.
constexpr double kTwoStepContactRatio = 300.0;

// The same in units of the inertia of what hangs from the tendon, T/g over the step's weight squared, as far
// as that is more [-]; and for two-step methods. By g = (N_0 - N)/k, N_0 the force of a step ago, the contact
// works N g' = dt N'^2/k on what vibrates, on average over a cycle: it never dies away where that is more
// than the method damps, for two-step methods at k < 4 m/dt^2, and weights creep over rough edges in steps of
// a coarse tendon. Smaller: they do. Larger: active contacts are found in more iterations.
constexpr double kHungRatio = 1.0;
constexpr double kTwoStepHungRatio = 4.0;

// Depth, in radii, from which a contact is stiffened within the step, by how much, and until when [-].
// Stiffer: what the sliding of a segment over an edge presses in becomes a wild force.
constexpr double kDepth = 5e-4;
constexpr double kStiffening = 10.0;
constexpr double kMostStiffening = 50.0;

// Depth that a step pushes out at most, in radii [-]. Depth over the step's length is a velocity, which
// stays: larger, and a tendon that was put into a bone is shot out of it. Smaller: it takes longer.
constexpr double kPushOut = 0.5;

// Residual over the forces at hand under which the curvature of a mouth's edge, which may make the matrix
// indefinite, is believed [-]. Larger: wild normal forces throw iterations off. Smaller: what slides over an
// edge takes more of them.
constexpr double kNear = 0.2;
// The same from which it is not believed any more.
constexpr double kLost = 0.5;

// Force, as a share of the forces at hand, by which following its points may change a pair's, and the share
// of it that is left once iterations have been thrown off by it [-]: pairs that jump more keep their points.
// Larger: more iterations until they do. Smaller: more pairs do, and get rows at their other points besides.
constexpr double kMostJump = 0.02;
constexpr double kLessJump = 0.25;

// Stiffness of a sticking contact, in the same units [-]. It sets how far a contact yields before it
// slides (micrometres). Larger: the corner between sticking and sliding gets so sharp that
// iterations step over it. Smaller: a sticking tendon gives visibly.
constexpr double kGripRatio = 1.0;

// What the particle's inertia adds to that, in units of the inertia [-]. What is laid on a slope gathers
// g dt before its contacts are stretched: with friction larger than its weight's pull by a share of less than
// about 1 / this, it slips first. Larger: more iterations. Smaller: tendons that should lie creep first.
constexpr double kLooseGripRatio = 300.0;

// Both for methods that carry no multipliers, in units of all the stiffness that a particle has [-].
// Larger: worse conditioned. Smaller: deeper contacts.
constexpr double kSpringRatio = 10.0;
constexpr double kSpringGripRatio = 0.1;

// Strain at which the material's tangent is taken for the contact stiffness of a slack tendon [-].
// A power law has no stiffness at rest, and a contact must be stiff before the load comes.
constexpr double kReferenceStrain = 0.01;

// Floor under a multiplier, as a share of the largest residual force [-]: the force up to which a
// spring is taken to be tight. 0: a slack tendon of a stiffening law transmits nothing, and a load
// travels one segment an iteration. Larger: slack tendons look stiff, and more iterations are needed.
constexpr double kFloorShare = 1e-2;

// Share of the inertia m/b^2 that a compressed spring may take off a particle [-]. Each particle has
// up to four springs, and a difference of displacements squared is at most twice the sum of their
// squares: below 1/8 the matrix stays definite whatever the compression.
constexpr double kInertiaShare = 0.12;

// Shear springs with a smaller share of the stiffness are left out [-].
constexpr double kLeastShear = 1e-12;

// Stands for an inertia that outweighs every compression [1/s^2].
constexpr double kNoCut = 1e300;

// Growth of a step from the last one up to which BDF2 goes on [-]: 1 + sqrt(2), where it ceases to be stable
// (Grigorieff 1983). After shorter ones it is restarted.
constexpr double kMostGrowth = 2.414;

// What a touched tendon's velocities are off by from where their last change led, squared, as a share of
// their own squares, above which its next step is taken by implicit Euler [-]. Larger: heaps go on vibrating
// by methods of second order. Smaller: what swings beside a contact in more than about 12 steps loses their
// order.
constexpr double kRough = 0.01;
// Speed, in radii a second, up to which what touches something takes all its steps by implicit Euler [1/s].
// Larger: what is drawn slowly loses its order. Smaller: BDF2 keeps heaps from falling asleep.
constexpr double kCreep = 1e-3;

// Newton iterations with carried multipliers without progress (the residual under this share of the
// best so far) before the step is split [-]. Mixed iterations may raise the residual on their way, so
// less patience splits what would converge; more makes violent steps slower.
constexpr int kMixedIterations = 10;
// The same for every so many contacts besides, and at most: contacts are made and lost one by one.
constexpr int kContactsAnIteration = 20;
constexpr int kMostPatience = 60;
constexpr double kProgress = 0.9;

// Residuals that are the same up to this [-], within so many iterations, are taken for a circle. Looser: half
// steps are taken for nothing. Tighter, or fewer iterations: circles are gone round until patience ends.
constexpr double kSameResidual = 1e-3;
constexpr int kLongestCircle = 12;
// Iterations without progress from which on half steps are taken. More: heaps go on for long.
constexpr int kIdle = 6;

// Sine of the angle that a segment is predicted to turn by in a step above which BDF2 takes it in substeps [-].
// Larger: the crack of a whip is lost. Smaller: fast spinning costs more.
constexpr double kTurn = 0.6;

// Speed up to which a tendon is at rest, in radii a second [1/s], for how long until it sleeps [s], and in
// how many steps at least (sleep.cpp). Faster, or sooner: what creeps, or turns back, is stopped. Slower, or
// later: heaps, which settle ever more slowly, are solved for longer.
constexpr double kRestSpeed = 1e-5;
constexpr double kRestTime = 0.5;
// Share of its largest force, or of its weight, that a tendon's dampers carry at most when it is at rest [-].
constexpr double kRestDamped = 1e-4;
constexpr int kRestSteps = 30;

// A step is solved again at most this often, because friction limits moved with the normal forces by
// more than the share [-] given, or pairs were missed. Fewer: such changes lag by a step. Larger share: what
// slides is off by as much, and rounding decides by how much.
constexpr int kRounds = 8;
constexpr double kFrictionAccuracy = 1e-6;

// Residual over the forces at hand under which it is seen to that before the solution is exact, and over what
// the last round began with [-]. Larger: limits and depths are wild, and rounds are used up by that. Smaller:
// each round is solved to an accuracy that the next one throws away.
constexpr double kLooseRound = 3e-3;
constexpr double kNextRound = 0.5;

// Change of a contact's force that is foreseen, as a share of it, up to which its friction limit goes along
// at once [-]. Larger: limits follow wild forces. Smaller: rounds of solutions do what iterations could.
constexpr double kAgreed = 0.3;

// How well limits are solved for beside the step [-], and by how many solutions at most (limits.cpp). Looser,
// or fewer: more iterations, each with a factorisation. More: solutions for what the next iteration changes.
constexpr double kLimitAccuracy = 0.03;
constexpr int kLimitSolutions = 8;

// Loosest relative accuracy of conjugate gradients within Newton's method [-].
constexpr double kLoosest = 1e-2;

// A contact this share of its radii too near gets another row in the same step [-], unless its
// nearest points are within kNearlySame of a segment of where a row already is.
constexpr double kPairDepth = 0.002;
constexpr double kNearlySame = 1e-3;

// Rows that may be added so in one step and group [-].
constexpr int kMostExtraRows = 256;

// Least weight of a free particle for a contact on a segment whose other end is held rigidly [-].
constexpr double kLeastLever = 0.25;

// Coordinates of iterates, in those that the step begins with or aims at, beyond which they have run away
// [-]. Larger: a residual there passes for rounding. Smaller: a taut tendon let go may snap back so far in a
// long step.
constexpr double kFarOff = 1e3;

// Share of the energy at hand under which what a step made out of nothing is rounding [-], and sweeps of
// impulses, along springs and contacts and across them, by which it is taken back.
constexpr double kCreated = 1e-12;
constexpr int kBrakes = 4;

// Share of a body's inertia that is left of it in the matrix at least, when what makes contacts and
// compressed springs indefinite is let in [-]. Smaller: wild steps of light bodies. Larger: curvature is cut
// off more often, and iterations are slower.
constexpr double kInertiaLeft = 0.5;

// A step that takes a particle this many lengths of its tendon away has failed [-]: forces can no longer
// be told from rounding.
constexpr double kRunaway = 1e12;

// A directly constrained particle that let go this often in a step stays free for its rest [-].
constexpr int kMostChanges = 4;


// Rounding allowance on a force, in units of (machine epsilon x stiffness x coordinate) [-].
constexpr double kRounding = 8.0;

// Least cosine between a stretch of tendon's segments and its chord for it to count as straight [-].
constexpr double kStraight = 0.75;

// What a surface is nearer to the inside of a segment than to its ends, in radii, for the segment to get
// a contact of its own [-]. Larger: rounded bones go deeper in between. Smaller: contacts on flat ones
// come three to a segment, and share the load as rounding has it.
constexpr double kNoBulge = 1e-5;

// Distance of two stretches of one tendon, in sums of radii, under which they are laid through each other
// [-]. Larger: what touches at the start gets through itself. Smaller: a crumpled start ties knots.
constexpr double kOverlaid = 0.5;
// The same under which neighbours of such pairs are laid through each other too [-]: no contact is so deep.
constexpr double kStillOverlaid = 0.9;

// Stretches of eight segments that are looked at for being straight together at most [-].
constexpr int kFarthestStretch = 64;

// Steps of the search for a segment's nearest point to an edge, an iteration [-]; it goes on from the last
// one.
constexpr int kFollowing = 4;

// Square of the sine between two segments over which their nearest points are followed [-]. Smaller: those of
// nearly parallel ones run to and fro.
constexpr double kCrossing = 3e-2;
// What the ends of two nearly parallel segments may be farther apart by than their nearest points to draw the
// contact towards them, in sums of radii [-]. Larger: the nearer end goes deeper. Smaller: what lies side by
// side is pushed at one end in one step and at the other in the next.
constexpr double kPairEnds = 5e-3;
// By how much tendons part, an arc along both, from where they are held nearer to each other than they are
// thick [-]. Larger: what is held at one point is bent there, and stretched by that. Smaller: it overlaps for
// longer.
constexpr double kParting = 0.1;

// Distance of centrelines, in sums of radii, under which their own direction is not believed any more [-].
constexpr double kNearlyMet = 0.2;

// Contacts are foreseen over the motion that the step is begun with, and this share of the radius [-].
// What moves otherwise than that makes the step look again. Larger: more queries and rows. Smaller:
// more looks.
constexpr double kSlack = 0.05;

// A step looks again for contacts at most this often. Fewer: contacts that appear one after another
// are met a step late.
constexpr int kLooks = 6;

// Within a part of a step, what is near something moves by at most this share of the radius (of both
// radii, for two tendons) relative to it [-]: a centreline that starts outside then cannot get through,
// wherever the nearest points go. Larger: it can. Smaller: more parts.
constexpr double kFarthestMove = 0.9;

// Times that two segments are advanced towards each other at most to see when they could touch [-]. Fewer:
// steps are taken in parts because of what passes by.
constexpr int kAdvances = 8;

// One and the cosine of a turn, up to which it may as well be about any axis [-].
constexpr double kHalfTurn = 1e-9;

// Methods that do not split their steps foresee tendon pairs up to this many sums of radii [-]. A row
// is a plane; far from touching it would hold back what passes beside it.
constexpr double kFarthest = 2.0;

// A tunnel's bore is taken to reach this many radii beyond its mouths when bone surface is looked
// for [-]: a mouth drilled at up to 63 degrees from the surface's normal leaves no lid.
constexpr double kBoreReach = 2.0;

// A direction that a body can be moved in is a new one where this share of its square is left beside the
// others [-]. Larger: bodies do not yield where they could. Smaller: rounding counts as a direction.
constexpr double kSameDirection = 1e-20;

// Two segments of one tendon can touch when the arc between them exceeds this many radii [-]: a
// tendon bent as tightly as a tube can (centreline radius = tendon radius) touches itself after
// half a turn. Smaller: neighbours push each other apart in every bend.
constexpr double kSelfContactArc = 3.14159265358979;

}  // namespace bt
