// As in constants.h, of the bodies that tendons move: what is learned of them, what stops them, what pybullet
// does to them.
#pragma once

namespace bt {

// Share of a held link's free answer, along the wrench, by which it has to exceed what was foreseen for
// it to have been let go [-]. Larger: light bodies are shot off. Smaller: held ones are solved twice.
constexpr double kReleased = 0.2;

// Stretch of a tendon by what pulled its body away unforeseen, in lengths of the tendon, from which the step
// is mended [-], and share of that motion by which it may differ from what the velocity makes of a step, as
// where pybullet takes substeps. Larger: a sudden pull is answered to a step late. Smaller: blows that do not
// matter are solved for twice.
constexpr double kSuddenPull = 1e-4;
constexpr double kSubsteps = 0.6;
// Farthest that it may have turned the body for the step to be mended, which takes arms as they were [rad].
// Larger: what is thrown about is thrown back.
constexpr double kFarthestTurn = 0.2;
// Square of the angle that a body turns by in a step [rad^2] from which it is solved for with arms as they
// are at the end of the step. Larger: what is attached lags behind. Smaller: three more unknowns for what
// hardly turns, and its swinging is damped.
constexpr double kFarTurn = 0.01;
// The same of the share of a turn that the arm of a pull would swing by in it, dt^2 |f| |r| / (moment of
// inertia) [-]. Larger: light bodies swing up under taut tendons, from 4 on without end. Smaller: bodies that
// hardly turn are pushed by other torques than arms at the start of the step have.
constexpr double kFarSwing = 0.25;
// pybullet turns a body by the whole of its spin over a step up to this angle, and then by less [rad].
constexpr double kTurnsAsTold = 0.78539816339744831;
// Square of an angle under which its functions are taken by their series [rad^2].
constexpr double kSmallTurn = 1e-3;
// Rate at which pybullet cuts off what is faster [m/s], [rad/s]: what did that to it cannot be told. Share of
// it from which a rate is taken for one that was cut off [-]: damping comes after.
constexpr double kMostRate = 100.0;
constexpr double kCutOff = 0.999;

// Share of a wrench by which it has to change for something to be learned of its change, the same for the
// link to be thought to yield more than before, share of the free answer to the change by which the link has
// to miss what was foreseen, and least cosine between both for the one to explain the other [-].
constexpr double kLeastNews = 1e-3;
constexpr double kYieldNews = 0.1;
constexpr double kLeastMiss = 0.1;
constexpr double kLeastCosine = 0.1;

// Share of the largest eigenvalue of a response under which it is nothing [-]: joints yield in some
// directions only.
constexpr double kRank = 1e-9;

// Share of a degree of freedom's own mass (or response) under which what the others leave of it is rounding
// [-]. Larger: light bodies that carry heavy links do not answer.
constexpr double kMassless = 1e-13;

// Share of the depth behind a joint's limit that pybullet takes back in a step (Bullet's erp) [-]. It cannot
// be asked for; where it was set otherwise, that is learned as what holds the body.
constexpr double kTakenBack = 0.2;
// What a contact may be deep without being pushed apart [m], and the share of the rest that is taken back in
// a step [-] (pybullet's slop and contactERP, as it sets them; they cannot be asked for).
constexpr double kContactSlop = 1e-5;
constexpr double kContactTakenBack = 0.08;

// How far a body may have moved since its contacts were asked for [m], [half a radian], and share of what
// they held it back by [m/s] by which they may have missed that, for the same ones to hold it now [-].
// Larger: they are taken for what they no longer are. Smaller: they are asked for in every step.
constexpr double kContactsStand = 1e-5;
constexpr double kSteadyContact = 1e-3;

// A limit or contact acts where what it changes is more than this share of the rates at hand [-]: rounding.
constexpr double kLeastPush = 1e-9;

// Sweeps over the limits and contacts of a body at most, to find which ones stop it, and change of a rate by
// one, as a share of those at hand, under which no more are made [-]. Fewer: wrong ones of many.
constexpr int kStopSweeps = 100;
constexpr double kStopSettled = 1e-11;

// A part of a step is solved again at most this often because other limits and contacts act than foreseen.
constexpr int kSettlings = 8;

// Share of what was missing to the rate at a limit or contact that has to be made up for the limit to be
// believed [-].
constexpr double kLeastStopped = 0.5;

// Depth from which it does not (its split impulse) [rad], [m].
constexpr double kDeepBehind = 0.04;

// Cosine of force and torque under which a wrench is one force at some point: rounding [-].
constexpr double kAcross = 1e-14;

// Sweeps of Jacobi's method at most [-]; it converges quadratically, in four to six. Share of the largest
// entry under which one beside the diagonal is rounding [-].
constexpr int kSweeps = 12;
constexpr double kOffDiagonal = 1e-18;

}  // namespace bt
