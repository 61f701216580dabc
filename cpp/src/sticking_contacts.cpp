#include "sticking_contacts.hpp"

#include <cmath>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "vsr2/constants.hpp"

namespace vsr2 {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::Vector4d;

// From the greedy sets of closed contacts on the first wrong contact is changed, which reaches each of the
// 16 sets at most once, as long as no single contact is left: that one lets the rock spin, which is another
// problem.
constexpr std::int64_t kMostSets = kSticking.greedy_sets + 16;

class Solver {
 public:
  explicit Solver(StickingProblem& problem) : p_(problem), linear_(problem.linear) {
    for (int i = 0; i < p_.count; ++i)
      if (p_.contacts[i].normal > 0.0) closed_[size_++] = i;
  }

  bool solve() {
    for (std::int64_t tries = 0; tries < kMostSets; ++tries) {
      if (!move()) return false;
      const bool changed =
          tries < kSticking.greedy_sets ? open_pulling() || close_sinking() : change_first_wrong();
      if (!changed) return share();
    }
    return false;
  }

 private:
  StickingContact& closed(int k) { return p_.contacts[closed_[k]]; }
  const StickingContact& closed(int k) const { return p_.contacts[closed_[k]]; }

  // The joint as the rock's motion over the support feels it, the spin third: k, D^-1 k and 1 / S of
  // sticking_contacts.hpp.
  struct Coupling {
    Vector4d along = Vector4d::Zero();
    Vector4d shift = Vector4d::Zero();
    double inverse = 0.0;

    // n D^-1 k of a contact whose normal impulse also turns the rock by `brake` [m].
    double at(const StickingContact& contact, double brake = 0.0) const {
      return (shift[0] * contact.y - shift[1] * contact.x) + (shift[2] * brake + shift[3]);
    }
  };

  bool has_joint() const { return p_.joint.response > 0.0; }

  // Velocities are those of the support where its contact points are.
  void take_gap() {
    gap_.setZero();
    for (int k = 0; k < size_; ++k) gap_ += closed(k).gap / size_;
    linear_ = p_.linear + p_.joint.turn.cross(gap_);
    carry_ = p_.joint.carry - p_.joint.axis.cross(gap_);
  }
  // What the support's turning adds to the normal velocity at a contact of another gap.
  double lift(const StickingContact& at, const Vector3d& turn) const {
    return turn.x() * (at.gap.y() - gap_.y()) - turn.y() * (at.gap.x() - gap_.x());
  }

  Vector4d coupling_along(double x, double y, double z) const {
    const Vector3d& e = carry_;
    const Vector3d turn = p_.inertia * p_.joint.axis +
                          p_.mass * Vector3d(z * e.y(), -z * e.x(), y * e.x() - x * e.y());
    return {turn.x(), turn.y(), turn.z(), p_.mass * e.z()};
  }

  bool couple(const Vector4d& along, const Vector4d& shift, Coupling& joint) const {
    const Vector3d& p = p_.joint.axis;
    const double inertia = 1.0 / p_.joint.response + p.dot(p_.inertia * p) +
                           p_.mass * carry_.squaredNorm() - along.dot(shift);
    joint = {along, shift, 1.0 / inertia};
    return inertia > 0.0;
  }

  // Gives the support its rate of pitch, and the rock what that leaves of its motion. `lifting`: impulse
  // by which contacts of unequal gaps turn the support alone [N m s].
  void pitch(const Coupling& joint, double lifting = 0.0) {
    const double push = p_.joint.axis.dot(p_.inertia * p_.angular) +
                        p_.mass * carry_.dot(linear_) + lifting;
    pitch_rate_ = joint.inverse * (push - joint.along.dot(Vector4d(a_, b_, spin_, c_)));
    a_ -= pitch_rate_ * joint.shift[0];
    b_ -= pitch_rate_ * joint.shift[1];
    spin_ -= pitch_rate_ * joint.shift[2];
    c_ -= pitch_rate_ * joint.shift[3];
  }

  // Normal velocity at a contact.
  double rise(const StickingContact& at) const {
    const double level = c_ + a_ * at.y - b_ * at.x;
    return has_joint() ? level + lift(at, p_.joint.turn + pitch_rate_ * p_.joint.axis) : level;
  }

  // Impulses and velocity with the contacts that are taken for closed.
  bool move() {
    if (has_joint()) take_gap();
    if (size_ == 0) {
      a_ = p_.angular.x();
      b_ = p_.angular.y();
      c_ = linear_.z();
      pitch_rate_ = 0.0;
      return true;
    }
    if (size_ > 1) return move_without_spin();
    const double brake = closed(0).bounds.spinning(1.0);
    if (!(brake > 0.0)) return move_about_one(0.0);
    if (!move_without_spin()) return false;
    const double stops = spinning_impulse();
    if (!(lambda_[0] > 0.0) || std::fabs(stops) <= brake * lambda_[0]) return true;
    return move_about_one(std::copysign(brake, stops));
  }

  bool move_without_spin() {
    const double m = p_.mass;
    double z = 0.0;
    for (int k = 0; k < size_; ++k) z += closed(k).z;
    z /= size_;
    for (int k = 0; k < size_; ++k)
      if (std::fabs(closed(k).z - z) > kSticking.level * std::fabs(z)) return false;
    spin_ = 0.0;
    const double xx = p_.inertia(0, 0) + m * z * z, yy = p_.inertia(1, 1) + m * z * z;
    const double xy = p_.inertia(0, 1);
    const double over = 1.0 / (xx * yy - xy * xy);
    const double r_xx = yy * over, r_yy = xx * over, r_xy = -xy * over;
    const Vector3d momentum = p_.inertia * p_.angular;
    double along_x = momentum.x() + m * z * linear_.y();
    double along_y = momentum.y() - m * z * linear_.x();
    a_ = r_xx * along_x + r_xy * along_y;
    b_ = r_xy * along_x + r_yy * along_y;
    c_ = linear_.z();
    Coupling joint;
    if (has_joint()) {
      Vector4d k = coupling_along(0.0, 0.0, z);
      k[2] = 0.0;
      if (!couple(k, {r_xx * k[0] + r_xy * k[1], r_xy * k[0] + r_yy * k[1], 0.0, k[3] / m}, joint))
        return false;
      pitch(joint);
    }
    // The compliance of the normal rows, whose lower triangle Cholesky's decomposition takes.
    double compliance[4][4];
    for (int k = 0; k < size_; ++k) {
      const StickingContact& at = closed(k);
      const double by_x = r_xx * at.y - r_xy * at.x, by_y = r_xy * at.y - r_yy * at.x;
      for (int j = 0; j <= k; ++j)
        compliance[k][j] = (by_x * closed(j).y - by_y * closed(j).x) + 1.0 / m;
      if (has_joint())
        for (int j = 0; j <= k; ++j)
          compliance[k][j] += joint.inverse * (joint.at(at) - lift(at, p_.joint.axis)) *
                              (joint.at(closed(j)) - lift(closed(j), p_.joint.axis));
      compliance[k][k] += p_.softness;
      lambda_[k] = at.target - rise(at);
    }
    if (!solve_by_cholesky(compliance)) return false;
    double sum = 0.0, lifting = 0.0;
    for (int k = 0; k < size_; ++k) {
      along_x += lambda_[k] * closed(k).y;
      along_y -= lambda_[k] * closed(k).x;
      sum += lambda_[k];
      if (has_joint()) lifting += lambda_[k] * lift(closed(k), p_.joint.axis);
    }
    a_ = r_xx * along_x + r_xy * along_y;
    b_ = r_xy * along_x + r_yy * along_y;
    c_ = linear_.z() + sum / m;
    if (has_joint()) pitch(joint, lifting);
    x_ = y_ = 0.0;
    z_ = z;
    return true;
  }

  // lambda_ from the right-hand side in it.
  bool solve_by_cholesky(double (&of)[4][4]) {
    for (int k = 0; k < size_; ++k) {
      for (int j = 0; j < k; ++j) {
        double sum = of[k][j];
        for (int i = 0; i < j; ++i) sum -= of[k][i] * of[j][i];
        of[k][j] = sum * of[j][j];
        of[k][k] -= of[k][j] * of[k][j];
        lambda_[k] -= of[k][j] * lambda_[j];
      }
      if (!(of[k][k] > 0.0)) return false;
      of[k][k] = 1.0 / std::sqrt(of[k][k]);
      lambda_[k] *= of[k][k];
    }
    for (int k = size_ - 1; k >= 0; --k) {
      for (int j = k + 1; j < size_; ++j) lambda_[k] -= of[j][k] * lambda_[j];
      lambda_[k] *= of[k][k];
    }
    return true;
  }

  // About one contact, on which the rock spins against `brake` per normal impulse [m].
  bool move_about_one(double brake) {
    const StickingContact& at = closed(0);
    const double m = p_.mass;
    const Vector3d by_x(0.0, -at.z, at.y), by_y(at.z, 0.0, -at.x);
    const Matrix3d inertia = p_.inertia + m * (by_x * by_x.transpose() + by_y * by_y.transpose());
    const Matrix3d response = inertia.inverse();
    const Vector3d before = response * (p_.inertia * p_.angular +
                                        m * (linear_.x() * by_x + linear_.y() * by_y));
    const Vector3d by_impulse = response * Vector3d(at.y, -at.x, brake);
    a_ = before.x();
    b_ = before.y();
    spin_ = before.z();
    c_ = linear_.z();
    double compliance = at.y * by_impulse.x() - at.x * by_impulse.y() + 1.0 / m + p_.softness;
    Coupling joint;
    if (has_joint()) {
      const Vector4d k = coupling_along(at.x, at.y, at.z);
      Vector4d shift;
      shift << response * k.head<3>(), k[3] / m;
      if (!couple(k, shift, joint)) return false;
      pitch(joint);
      compliance += joint.inverse * joint.at(at) * joint.at(at, brake);
    }
    if (!(compliance > 0.0)) return false;
    lambda_[0] = (at.target - rise(at)) / compliance;
    const Vector3d after = before + lambda_[0] * by_impulse;
    a_ = after.x();
    b_ = after.y();
    c_ = linear_.z() + lambda_[0] / m;
    spin_ = after.z();
    if (has_joint()) pitch(joint);
    x_ = at.x;
    y_ = at.y;
    z_ = at.z;
    return !(brake * spin_ > 0.0);
  }

  // Opens the contact that pulls most.
  bool open_pulling() {
    int worst = -1;
    double least = 0.0;
    for (int k = 0; k < size_; ++k) {
      if (lambda_[k] > least) continue;
      least = lambda_[k];
      worst = k;
    }
    if (worst < 0) return false;
    open(worst);
    return true;
  }

  // Closes the open contact that sinks fastest.
  bool close_sinking() {
    int worst = -1;
    double greatest = 0.0;
    for (int i = 0, k = 0; i < p_.count; ++i) {
      if (k < size_ && closed_[k] == i) {
        ++k;
        continue;
      }
      const double sinks = p_.contacts[i].target - rise(p_.contacts[i]);
      if (!(sinks > greatest)) continue;
      greatest = sinks;
      worst = i;
    }
    if (worst < 0) return false;
    close(worst);
    return true;
  }

  // Murty's rule of the least index (Opsearch 11, 1974), which ends where the compliance is positive
  // definite.
  bool change_first_wrong() {
    for (int i = 0, k = 0; i < p_.count; ++i) {
      if (k < size_ && closed_[k] == i) {
        if (!(lambda_[k] > 0.0)) {
          open(k);
          return true;
        }
        ++k;
      } else if (p_.contacts[i].target - rise(p_.contacts[i]) > 0.0) {
        close(i);
        return true;
      }
    }
    return false;
  }

  void open(int k) {
    --size_;
    for (; k < size_; ++k) closed_[k] = closed_[k + 1];
  }
  void close(int i) {
    int k = size_++;
    for (; k > 0 && closed_[k - 1] > i; --k) closed_[k] = closed_[k - 1];
    closed_[k] = i;
  }

  // Changes of the rock's own velocity.
  Vector3d turned() const {
    return Vector3d(a_, b_, spin_) - p_.angular + pitch_rate_ * p_.joint.axis;
  }
  Vector3d shifted() const {
    return Vector3d(spin_ * y_ - z_ * b_, z_ * a_ - spin_ * x_, c_) - linear_ +
           pitch_rate_ * carry_;
  }

  // About the vertical through the first contact.
  double spinning_impulse() const {
    const Vector3d lateral = p_.mass * shifted();
    return p_.inertia.row(2).dot(turned()) -
           (closed(0).x * lateral.y() - closed(0).y * lateral.x());
  }

  // Gives each contact its part of the lateral impulse, if friction allows it: as its normal
  // impulse is of all, with a turn about their centre.
  bool share() {
    for (int i = 0; i < p_.count; ++i)
      p_.contacts[i].normal = p_.contacts[i].lateral_x = p_.contacts[i].lateral_y = 0.0;
    if (size_ == 0) {
      p_.angular.setZero();
      p_.linear.setZero();
      p_.pitch_rate = 0.0;
      return true;
    }
    const Vector3d dw = turned(), dv = shifted();
    double sum = 0.0, x = 0.0, y = 0.0;
    for (int k = 0; k < size_; ++k) {
      sum += lambda_[k];
      x += lambda_[k] * closed(k).x;
      y += lambda_[k] * closed(k).y;
    }
    x /= sum;
    y /= sum;
    double polar = 0.0;
    for (int k = 0; k < size_; ++k) {
      const double d_x = closed(k).x - x, d_y = closed(k).y - y;
      polar += lambda_[k] * (d_x * d_x + d_y * d_y);
    }
    const double f_x = p_.mass * dv.x(), f_y = p_.mass * dv.y();
    const double torque = p_.inertia.row(2).dot(dw) - (x * f_y - y * f_x);
    const double turn = size_ > 1 ? torque / polar : 0.0;
    for (int k = 0; k < size_; ++k) {
      StickingContact& at = closed(k);
      const double s_x = f_x / sum - turn * (at.y - y), s_y = f_y / sum + turn * (at.x - x);
      const double greatest = at.bounds.lateral(1.0);
      if (!(s_x * s_x + s_y * s_y < greatest * greatest)) return false;
      at.normal = lambda_[k];
      at.lateral_x = lambda_[k] * s_x;
      at.lateral_y = lambda_[k] * s_y;
    }
    p_.angular = dw;
    p_.linear = dv;
    p_.pitch_rate = pitch_rate_;
    return true;
  }

  StickingProblem& p_;
  Vector3d linear_;
  Vector3d carry_ = Vector3d::Zero();
  Vector3d gap_ = Vector3d::Zero();  // mean of the closed contacts'
  int closed_[4];  // in rising order
  int size_ = 0;
  double lambda_[4];
  // Relative velocity after the impulses, and the point (x, y, z) that has no lateral one.
  double a_ = 0.0, b_ = 0.0, c_ = 0.0, spin_ = 0.0;
  double pitch_rate_ = 0.0;  // change of the support's
  double x_ = 0.0, y_ = 0.0, z_ = 0.0;
};

}  // namespace

bool solve_sticking(StickingProblem& problem) { return Solver(problem).solve(); }

}  // namespace vsr2
