#pragma once
// Bullet's multibody solver with its iterations on rows laid out flat; private to the core.
//
// The rows and their equation are those of contact_rows.hpp, but Bullet's sums run in another order
// and over other numbers: it multiplies a row's velocity by the inverse mass after summing, body by
// body, where a ContactRow carries the product. That changes last bits, and this engine must give
// Bullet's, so it keeps Bullet's Jacobians and has a sweep of its own.

#include <cstddef>
#include <vector>

#include <BulletDynamics/Featherstone/btMultiBodyConstraintSolver.h>

namespace vsr2 {

/// Same rows, same order of operations, same bits as btMultiBodyConstraintSolver, for one free
/// body in contact with one body on a chain of up to four joints (the slider) and fixed ones. Anything
/// else goes to the base class.
///
/// The iteration is a fixed map of its state (impulses and velocity changes). Once a state comes
/// back bit for bit the rest is a cycle, and only the part of it is run that leads to the state of
/// the last iteration.
class ExactSolver final : public btMultiBodyConstraintSolver {
 public:
  /// Takes the memory for two full manifolds at once.
  ExactSolver();

 protected:
  btScalar solveGroupCacheFriendlyIterations(btCollisionObject** bodies, int numBodies,
                                             btPersistentManifold** manifolds, int numManifolds,
                                             btTypedConstraint** constraints, int numConstraints,
                                             const btContactSolverInfo& info,
                                             btIDebugDraw* drawer) override;

 public:
  static constexpr int kJoints = 4;
  /// One row: `j` the free body's velocity to the row's, `d` the row's unit impulse to the free
  /// body's velocity change; `js`, `ds` the same for the slider.
  struct Row {
    double j[6];
    double d[6];
    double js;
    double ds;
    double rhs;
    double cfm;
    double inverse;  ///< of the effective inverse mass
    double friction;
    double lower;
    double upper;
    double applied;
    double change;       ///< impulse of the latest iteration
    std::size_t normal;  ///< index of the normal row whose impulse bounds a friction row
    bool free_is_a;
    double js_more[kJoints - 1];  ///< of joints after the first
    double ds_more[kJoints - 1];
  };
  struct System {
    std::vector<Row> motor;
    std::vector<Row> normals;
    std::vector<Row> spinning;
    std::vector<Row> rolling;   ///< pairs
    std::vector<Row> friction;  ///< pairs
    double v[6];
    double vs[kJoints];
    int joints = 0;  ///< of the slider; 0: no row has it
  };

 private:
  bool flatten(const btContactSolverInfo& info, int numConstraints);
  bool flatten(const btMultiBodyConstraintArray& rows, std::vector<Row>& out, bool motor);
  void write_back();
  void iterate(const btContactSolverInfo& info);

  btMultiBody* free_ = nullptr;
  btMultiBody* slider_ = nullptr;
  System system_;
  std::vector<double> saved_;
};

}  // namespace vsr2
