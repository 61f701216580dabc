// The engines `parity` and `exact`: Bullet's multibody world with PyBullet's settings, order of
// creation and way of placing bodies, so that all give the same bits.

#include <array>
#include <optional>
#include <vector>

#include <BulletDynamics/Featherstone/btMultiBody.h>
#include <BulletDynamics/Featherstone/btMultiBodyJointMotor.h>
#include <BulletDynamics/Featherstone/btMultiBodyLinkCollider.h>

#include "bullet_parts.hpp"
#include "bullet_world.hpp"
#include "contact_laws.hpp"
#include "drive_law.hpp"
#include "exact_solver.hpp"
#include "scene_shapes.hpp"
#include "vsr2/engines.hpp"

static_assert(sizeof(btScalar) == 8, "link Bullet's double-precision (-float64) libraries");

namespace vsr2 {
namespace {

// A prescribed pedestal carries this mass [kg]: no impulse of a rock changes a bit of its speed.
constexpr double kPrescribedMass = 1e30;
constexpr int kStaticGroup = btBroadphaseProxy::StaticFilter;
constexpr int kDefaultGroup = btBroadphaseProxy::DefaultFilter;

// Joints of a pedestal that moves in space: x, y and z of P's origin, then the turn about it. With
// the turn about the mass centre the joints do not act on one another.
constexpr int kSpatialJoints = 4;

class BulletWorld final : public BulletWorldBase {
 public:
  BulletWorld(std::shared_ptr<const Scene> scene, Drive drive,
              std::unique_ptr<btMultiBodyConstraintSolver> solver, btCollisionShape* rock_shape)
      : scene_(std::move(scene)),
        drive_(drive),
        pair_(combine(scene_->rock().material, scene_->pedestal().material)),
        rock_shape_(rock_shape ? rock_shape : scene_->shapes().rock),
        configuration_(small_pools()),
        dispatcher_(&configuration_, scene_->engine().contact_breaking_threshold),
        broadphase_(&pair_cache_),
        solver_(solver ? std::move(solver) : std::make_unique<btMultiBodyConstraintSolver>()),
        world_(&dispatcher_, &broadphase_, solver_.get(), &configuration_) {
    const EngineSettings& engine = scene_->engine();
    world_.setGravity(btVector3(0, 0, -engine.gravity));
    world_.getDispatchInfo().m_deterministicOverlappingPairs = engine.deterministic_overlapping_pairs;
    btContactSolverInfo& info = world_.getSolverInfo();
    // PyBullet's values; the parity tests hold them.
    info.m_erp2 = 0.08;
    info.m_frictionERP = 0.2;
    info.m_linearSlop = 1e-5;
    info.m_numIterations = engine.solver_iterations;
    info.m_leastSquaresResidualThreshold = engine.residual_threshold;
    info.m_minimumSolverBatchSize = 0;
    info.m_warmstartingFactor = 0.1;
    info.m_splitImpulse = true;
    info.m_splitImpulsePenetrationThreshold = -0.04;
    info.m_restitutionVelocityThreshold = engine.restitution_velocity_threshold;
    info.m_solverMode |= SOLVER_USE_2_FRICTION_DIRECTIONS;
    if (!engine.cone_friction) info.m_solverMode |= SOLVER_DISABLE_IMPLICIT_CONE_FRICTION;
    check_drive(scene_->pedestal(), drive_);
    if (scene_->pedestal().pitch_spring)
      joint_.emplace(*scene_, engine.time_step / engine.substeps);
    world_.before_solution = [this] { put_in_force(); };
    add_ground();
    add_robot();
    touches_.reserve(16);
  }

  ~BulletWorld() override {
    if (rock_.multibody) remove(rock_);
    if (motor_) world_.removeMultiBodyConstraint(motor_.get());
    remove(robot_);
    remove(ground_);
  }

  void spawn_rock(const Pose& X_WB) override {
    require_no_rock(has_rock());
    check_start(X_WB);
    std::optional<PitchJoint> loaded = joint_;
    if (loaded) loaded->start({X_WB.position}, spatial_);
    place_rock(X_WB);
    if (loaded) set_pitch_joint(*loaded);
    if (RockMechanics::needed(*scene_)) {
      mechanics_.emplace(*scene_);
      mechanics_->start(rock(), pedestal_motion(scene_->pedestal(), pedestal()));
    }
  }

  void take_over(const HandedOver& from) override {
    set_pedestal(from.pedestal);
    if (from.joint) set_pitch_joint(*from.joint);
    place_rock({from.rock.p_WB, from.rock.q_WB});
    set_rock_velocity(from.rock.v_WB, from.rock.w_WB);
    set_contacts(from.contacts);
    mechanics_ = from.mechanics;
  }

  void delete_rock() override {
    require_rock(has_rock());
    mechanics_.reset();
    remove(rock_);
  }

  bool has_rock() const override { return rock_.multibody != nullptr; }

  void set_rock_velocity(const Eigen::Vector3d& v_WB, const Eigen::Vector3d& w_WB) override {
    require_rock(has_rock());
    rock_.multibody->setBaseVel(to_bullet(v_WB));
    rock_.multibody->setBaseOmega(to_bullet(w_WB));
  }

  void step(const DriveTarget& target) override {
    check_target(scene_->pedestal(), drive_, target);
    const EngineSettings& engine = scene_->engine();
    const double dt = engine.time_step / engine.substeps;
    const PedestalState start = pedestal();
    for (int i = 1; i <= engine.substeps; ++i) {
      if (drive_ == Drive::prescribed_spatial) turn_normals();
      if (mechanics_)
        mechanise([&](RockState& state) { return mechanics_->begin_step(state, dt); });
      if (prescribes(drive_)) {
        prescribe(on_the_way(drive_, start, pedestal(), target, i, engine.substeps, dt), dt);
      } else {
        motor_->setVelocityTarget(MotorLaw::velocity_reference(drive_, target), MotorLaw::velocity_gain);
        motor_->setPositionTarget(target.position, MotorLaw::position_gain);
        motor_->setMaxAppliedImpulse(MotorLaw::maximum_impulse(engine));
      }
      solve(dt);
    }
  }

  const std::optional<PitchJoint>& pitch_joint() const override { return joint_; }

  PedestalState pedestal() const override {
    if (drive_ == Drive::prescribed_spatial) return spatial_;
    return {robot_.multibody->getJointPos(0), robot_.multibody->getJointVel(0)};
  }

  RockState rock() const override {
    require_rock(has_rock());
    const btMultiBody& body = *rock_.multibody;
    // Through a transform, as PyBullet reads an orientation out.
    const btQuaternion orientation = btTransform(body.getWorldToBaseRot().inverse()).getRotation();
    return {to_eigen(body.getBasePos()), to_eigen(orientation), to_eigen(body.getBaseVel()),
            to_eigen(body.getBaseOmega())};
  }

  void contacts(std::vector<ContactPoint>& out) const override {
    out.clear();
    each_contact(nullptr, [&](const btManifoldPoint& point, bool rock_is_a) {
      const double sign = rock_is_a ? 1.0 : -1.0;
      out.push_back({
          .p_W_rock = on_rock(point, rock_is_a),
          .p_W_pedestal = on_rock(point, !rock_is_a),
          .normal_W = sign * to_eigen(point.m_normalWorldOnB),
          .distance = point.getDistance(),
          .normal_impulse = point.m_appliedImpulse,
          .lateral_impulse_1 = point.m_appliedImpulseLateral1,
          .lateral_impulse_2 = point.m_appliedImpulseLateral2,
          .direction_1 = sign * to_eigen(point.m_lateralFrictionDir1),
          .direction_2 = sign * to_eigen(point.m_lateralFrictionDir2),
          .pair = pair_at(point, pair_),
      });
    });
  }

 private:
  void place_rock(const Pose& X_WB) {
    const Scene::Shapes& shapes = scene_->shapes();
    const EngineSettings& engine = scene_->engine();
    rock_.multibody = std::make_unique<btMultiBody>(0, scene_->rock().mass, shapes.rock_inertia,
                                                    false, false);
    btMultiBody& body = *rock_.multibody;
    body.setHasSelfCollision(false);
    body.setLinearDamping(engine.linear_damping);
    body.setAngularDamping(engine.angular_damping);
    body.finalizeMultiDof();
    btMultiBodyLinkCollider& collider = add_collider(rock_, -1, rock_shape_);
    set_material(collider, scene_->rock().material);
    world_.addCollisionObject(&collider, kDefaultGroup, btBroadphaseProxy::AllFilter);
    world_.addMultiBody(&body);
    body.setBaseVel(btVector3(0, 0, 0));
    body.setBasePos(to_bullet(X_WB.position));
    body.setBaseOmega(btVector3(0, 0, 0));
    // Not normalised: PyBullet places a body with the quaternion as given.
    body.setWorldToBaseRot(to_bullet(X_WB.orientation).inverse());
    refresh(body);
    world_.updateSingleAabb(&collider);
  }

  void set_pedestal(const PedestalState& state) {
    btMultiBody& robot = *robot_.multibody;
    if (drive_ == Drive::prescribed_spatial) {
      spatial_ = state;
      pitch_of_normals_ = state.excursion.pitch;
      const auto joints = spatial_joints(state);
      for (int j = 0; j < kSpatialJoints; ++j) robot.setJointPos(j, joints[j]);
    } else {
      robot.setJointPos(0, state.position);
      robot.setJointVel(0, state.velocity);
    }
    refresh(robot);
    for (auto& collider : robot_.colliders) world_.updateSingleAabb(collider.get());
  }

  void set_pitch_joint(const PitchJoint& joint) {
    joint_ = joint;
    PedestalState state = spatial_;
    state.excursion.pitch = joint.pitch();
    set_pedestal(state);
  }

  // Fills the contact cache between rock and pedestal, in the order given. Needs a pedestal of one
  // convex part, and no step since the rock was placed.
  void set_contacts(const std::vector<CachedContact>& contacts) {
    // A pass of collision detection makes the pair and its manifold.
    world_.performDiscreteCollisionDetection();
    each_manifold(pedestal_collider(), [&](btPersistentManifold& manifold, bool rock_is_a) {
      manifold.clearManifold();
      if (contacts.empty()) return;
      const auto wrap = [](const btCollisionObject* object) {
        return btCollisionObjectWrapper(nullptr, object->getCollisionShape(), object,
                                        object->getWorldTransform(), -1, -1);
      };
      const btCollisionObjectWrapper a = wrap(manifold.getBody0());
      const btCollisionObjectWrapper b = wrap(manifold.getBody1());
      btManifoldResult result(&a, &b);
      result.setPersistentManifold(&manifold);
      // Bullet combines the two materials when it makes a point; the place is filled in after.
      result.addContactPoint(btVector3(0, 0, rock_is_a ? 1 : -1), btVector3(0, 0, 0), 0.0);
      btManifoldPoint point = manifold.getContactPoint(0);
      manifold.clearManifold();
      for (const CachedContact& contact : contacts) {
        (rock_is_a ? point.m_localPointA : point.m_localPointB) = to_bullet(contact.p_B);
        (rock_is_a ? point.m_localPointB : point.m_localPointA) = to_bullet(contact.p_P);
        point.m_normalWorldOnB = (rock_is_a ? 1.0 : -1.0) * to_bullet(contact.normal_W);
        manifold.addManifoldPoint(point);
      }
      manifold.refreshContactPoints(manifold.getBody0()->getWorldTransform(),
                                    manifold.getBody1()->getWorldTransform());
    });
  }

  void add_ground() {
    ground_.multibody = std::make_unique<btMultiBody>(0, 0.0, btVector3(0, 0, 0), true, false);
    btMultiBody& body = *ground_.multibody;
    body.setHasSelfCollision(false);
    body.finalizeMultiDof();
    body.setBasePos(btVector3(0, 0, -5));
    btMultiBodyLinkCollider& collider = add_collider(ground_, -1, scene_->shapes().ground.get());
    collider.setFriction(1.0);
    collider.setCollisionFlags(collider.getCollisionFlags() | btCollisionObject::CF_STATIC_OBJECT);
    refresh(body);
    world_.addCollisionObject(&collider, kStaticGroup, btBroadphaseProxy::AllFilter ^ kStaticGroup);
    world_.addMultiBody(&body);
  }

  void add_robot() {
    const Scene::Shapes& shapes = scene_->shapes();
    const PedestalSpec& pedestal = scene_->pedestal();
    const EngineSettings& engine = scene_->engine();
    const bool prescribed = prescribes(drive_);
    const bool spatial = drive_ == Drive::prescribed_spatial;
    const double mass = prescribed ? kPrescribedMass : pedestal.mass;
    const btVector3 inertia = shapes.pedestal_inertia * (mass / pedestal.mass);
    const Eigen::Vector3d base_centre(0, 0, 0.5 * pedestal.base_size.z());
    // What the first joints carry: P's origin, or the axis of the sprung joint.
    const Eigen::Vector3d carried = joint_ ? pitch_axis(pedestal, {}) : pedestal.p_WP0;
    robot_.multibody = std::make_unique<btMultiBody>(spatial ? kSpatialJoints : 1, 0.0,
                                                     btVector3(0, 0, 0), true, false);
    btMultiBody& body = *robot_.multibody;
    body.setHasSelfCollision(false);
    body.setBasePos(to_bullet(base_centre));
    body.setupPrismatic(0, mass, inertia, -1, btQuaternion(0, 0, 0, 1), btVector3(1, 0, 0),
                        to_bullet(Eigen::Vector3d(carried - base_centre)), btVector3(0, 0, 0),
                        true);
    if (spatial) {
      const btQuaternion straight(0, 0, 0, 1);
      const btVector3 zero(0, 0, 0);
      body.setupPrismatic(1, mass, inertia, 0, straight, btVector3(0, 1, 0), zero, zero, true);
      body.setupPrismatic(2, mass, inertia, 1, straight, btVector3(0, 0, 1), zero, zero, true);
      if (joint_) {
        add_sprung_link(body, pedestal.p_WP0 - carried);
      } else {
        body.setupRevolute(3, mass, inertia, 2, straight, btVector3(0, 1, 0), zero, zero, true);
      }
    }
    // Damping would slow a prescribed pedestal between the two ends of a step.
    body.setLinearDamping(prescribed ? 0.0 : engine.linear_damping);
    body.setAngularDamping(prescribed ? 0.0 : engine.angular_damping);
    body.finalizeMultiDof();
    btMultiBodyLinkCollider& base = add_collider(robot_, -1, shapes.base.get());
    base.setCollisionFlags(base.getCollisionFlags() | btCollisionObject::CF_STATIC_OBJECT);
    btMultiBodyLinkCollider& link = add_collider(robot_, body.getNumLinks() - 1, shapes.pedestal);
    set_material(link, pedestal.material);
    if (!shapes.triangle_edges.empty()) {
      install_contact_hook();
      link.setCollisionFlags(link.getCollisionFlags() |
                             btCollisionObject::CF_CUSTOM_MATERIAL_CALLBACK);
    }
    refresh(body);
    world_.addCollisionObject(&base, kDefaultGroup, kDefaultGroup);
    world_.addCollisionObject(&link, kDefaultGroup, kDefaultGroup);
    world_.addMultiBody(&body);
    if (!prescribed) {
      motor_ = std::make_unique<btMultiBodyJointMotor>(&body, 0, 0, 0.0, 1.0);
      motor_->setPositionTarget(0, 0);
      motor_->setVelocityTarget(0, MotorLaw::velocity_gain);
      motor_->setRhsClamp(MotorLaw::speed_limit);
      motor_->finalizeMultiDof();
      world_.addMultiBodyConstraint(motor_.get());
    }
  }

  // Contacts turn it as the joint's inertia asks, whatever the engine's own part in that; the other
  // joints' mass carries it. `arm`: from the axis to P's origin.
  void add_sprung_link(btMultiBody& body, const Eigen::Vector3d& arm) {
    const double response = joint_->inverse_inertia();
    const double about_axis = response > 0 ? 1.0 / response : kPrescribedMass;
    const double square = arm.squaredNorm();
    const double mass = 0.5 * about_axis / (1.0 + square);
    const double about_centre = about_axis - mass * square;
    const btVector3 zero(0, 0, 0);
    body.setupRevolute(3, mass, btVector3(about_centre, about_centre, about_centre), 2,
                       btQuaternion(0, 0, 0, 1), btVector3(0, 1, 0), zero, to_bullet(arm), true);
  }

  std::array<double, kSpatialJoints> spatial_joints(const PedestalState& state) const {
    if (joint_)
      return {state.position, state.excursion.transverse, state.excursion.vertical,
              state.excursion.pitch};
    const Eigen::Vector3d p =
        pedestal_motion(scene_->pedestal(), state).p_WP - scene_->pedestal().p_WP0;
    return {p.x(), p.y(), p.z(), state.excursion.pitch};
  }

  // Gives the pedestal the velocity that takes it to `next` in a solver step.
  void prescribe(PedestalState next, double dt) {
    btMultiBody& robot = *robot_.multibody;
    if (drive_ != Drive::prescribed_spatial) return robot.setJointVel(0, next.velocity);
    if (joint_) next.excursion.pitch = spatial_.excursion.pitch;
    const auto goal = spatial_joints(next);
    for (int j = 0; j < kSpatialJoints; ++j) {
      robot.setJointVel(j, (goal[j] - robot.getJointPos(j)) / dt);
      // Bullet adds the weight of every link when it steps.
      robot.addLinkForce(j, -world_.getGravity() * robot.getLinkMass(j));
    }
    if (joint_) robot.setJointVel(3, joint_->blow(next.velocity - spatial_.velocity));
    spatial_ = next;
  }

  // Bullet keeps a contact's normal in the world as it was found; the top that it belongs to turns.
  void turn_normals() {
    const double turn = spatial_.excursion.pitch - pitch_of_normals_;
    pitch_of_normals_ = spatial_.excursion.pitch;
    if (turn == 0.0) return;
    const btMatrix3x3 rotation(btQuaternion(btVector3(0, 1, 0), turn));
    each_contact(pedestal_collider(), [&](btManifoldPoint& point, bool) {
      point.m_normalWorldOnB = rotation * point.m_normalWorldOnB;
    });
  }

  // Lets the mechanisms change the rock's velocity, and the joint feel it.
  template <typename Act>
  void mechanise(Act act) {
    const RockState before = rock();
    RockState state = before;
    if (!act(state)) return;
    set_rock_velocity(state.v_WB, state.w_WB);
    if (joint_) joint_->react(before, state, spatial_);
  }

  void solve(double dt) {
    world_.stepSimulation(dt, 0);
    if (joint_) {
      const double rate = robot_.multibody->getJointVel(3);
      joint_->finish(rate);
      spatial_.excursion.pitch = joint_->pitch();
      spatial_.excursion_rate.pitch = rate;
    }
    if (!mechanics_) return;
    touches_.clear();
    each_contact(pedestal_collider(), [&](const btManifoldPoint& point, bool rock_is_a) {
      touches_.push_back({on_rock(point, rock_is_a),
                          (rock_is_a ? 1.0 : -1.0) * to_eigen(point.m_normalWorldOnB),
                          point.m_appliedImpulse});
    });
    mechanise([&](RockState& state) {
      return mechanics_->end_step(state, pedestal_motion(scene_->pedestal(), pedestal()), touches_, dt);
    });
  }

  // Bullet gives a point what it makes of two materials whenever it finds it again, so the values that
  // the laws have in force are put there for each solution.
  void put_in_force() {
    const bool scales = mechanics_ && scene_->mechanisms().sets_friction();
    each_contact(pedestal_collider(), [&](btManifoldPoint& point, bool rock_is_a) {
      const double scale = scales ? mechanics_->friction_scale(on_rock(point, rock_is_a),
                                                               to_eigen(point.m_normalWorldOnB))
                                  : 1.0;
      put_pair(point, in_force(pair_, scale));
    });
  }

  const btCollisionObject* pedestal_collider() const { return robot_.colliders.back().get(); }

  // Visits the manifolds between the rock and `other`, or any body, and whether the rock is first.
  template <typename Visit>
  void each_manifold(const btCollisionObject* other, Visit visit) const {
    if (!has_rock()) return;
    const btCollisionObject* rock = rock_.colliders.front().get();
    for (int m = 0; m < dispatcher_.getNumManifolds(); ++m) {
      btPersistentManifold* manifold = dispatcher_.getManifoldByIndexInternal(m);
      const bool rock_is_a = manifold->getBody0() == rock;
      if (!rock_is_a && manifold->getBody1() != rock) continue;
      if (!other || (rock_is_a ? manifold->getBody1() : manifold->getBody0()) == other)
        visit(*manifold, rock_is_a);
    }
  }

  template <typename Visit>
  void each_contact(const btCollisionObject* other, Visit visit) const {
    each_manifold(other, [&](btPersistentManifold& manifold, bool rock_is_a) {
      for (int i = 0; i < manifold.getNumContacts(); ++i)
        visit(manifold.getContactPoint(i), rock_is_a);
    });
  }

  static Eigen::Vector3d on_rock(const btManifoldPoint& point, bool rock_is_a) {
    return to_eigen(rock_is_a ? point.m_positionWorldOnA : point.m_positionWorldOnB);
  }

  void refresh(btMultiBody& body) {
    body.forwardKinematics(scratch_q_, scratch_m_);
    body.updateCollisionObjectWorldTransforms(scratch_q_, scratch_m_);
  }

  void remove(Body& body) {
    for (auto& collider : body.colliders) world_.removeCollisionObject(collider.get());
    world_.removeMultiBody(body.multibody.get());
    body.colliders.clear();
    body.multibody.reset();
  }

  std::shared_ptr<const Scene> scene_;
  Drive drive_;
  ContactValues pair_;  ///< of rock and pedestal
  btCollisionShape* rock_shape_;
  btDefaultCollisionConfiguration configuration_;
  mutable Dispatcher dispatcher_;
  PairCache pair_cache_;
  btDbvtBroadphase broadphase_;
  std::unique_ptr<btMultiBodyConstraintSolver> solver_;
  DynamicsWorld world_;
  Body ground_;
  Body robot_;
  Body rock_;
  std::unique_ptr<btMultiBodyJointMotor> motor_;
  PedestalState spatial_;  ///< of a pedestal that moves in space
  double pitch_of_normals_ = 0.0;  ///< of the pedestal, to which contacts' normals belong [rad]
  std::optional<PitchJoint> joint_;
  std::optional<RockMechanics> mechanics_;
  std::vector<Touch> touches_;
  btAlignedObjectArray<btQuaternion> scratch_q_;
  btAlignedObjectArray<btVector3> scratch_m_;
};

}  // namespace

std::unique_ptr<World> make_bullet_world(std::shared_ptr<const Scene> scene, Drive drive) {
  return std::make_unique<BulletWorld>(std::move(scene), drive, nullptr, nullptr);
}

std::unique_ptr<BulletWorldBase> make_exact_bullet_world(std::shared_ptr<const Scene> scene,
                                                         Drive drive) {
  btCollisionShape* rock = scene->shapes().scanned_rock;
  return std::make_unique<BulletWorld>(std::move(scene), drive, std::make_unique<ExactSolver>(), rock);
}

std::unique_ptr<World> make_exact_world(std::shared_ptr<const Scene> scene, Drive drive) {
  return make_exact_bullet_world(std::move(scene), drive);
}

}  // namespace vsr2
