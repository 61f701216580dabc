#include <gtest/gtest.h>

#include "contact_rows.hpp"

namespace vsr2 {
namespace {

using Vector7 = Eigen::Matrix<double, 7, 1>;

Vector7 flat(const VelocityChange<double>& v) {
  Vector7 out;
  out << Eigen::Vector3d(v.angular), Eigen::Vector3d(v.linear), v.joint;
  return out;
}

const Eigen::Vector3d kPoint(0.2, -0.1, -0.45);  // of a contact, from the mass centre

// A row's sparse operations against the dense Jacobian of its direction: k = J M^-1 J^T + c,
// speed = J v / k, apply = M^-1 J^T, and the joint where the row feels it.
template <typename Row>
void expect_dense(Row row, const Eigen::Vector3d& lever, const Eigen::Vector3d& direction,
                  double softness) {
  Eigen::Matrix3d K;
  K << 0.3, 0.02, -0.05, 0.02, 0.4, 0.01, -0.05, 0.01, 0.2;
  const RockResponse rock{1.0 / 350, K};
  const JointAtContact joint{{0.3, -0.2, 0.5}, 0.7, 0.004};
  row.template fill<Joint::pitch>(rock, kPoint, joint, 0.7, softness);
  const double by_joint = direction.isZero() ? joint.spin : direction.dot(joint.slip);
  Vector7 J;
  J << lever, direction, by_joint;
  Vector7 response;
  response << K * lever, rock.inverse_mass * direction, joint.response * by_joint;
  const double k = J.dot(response) + softness;
  EXPECT_NEAR(row.inverse_mass, k, 1e-14);
  VelocityChange<double> v{{0.1, -0.2, 0.3}, {0.4, 0.5, -0.6}, 0.8};
  EXPECT_NEAR(row.template speed<Joint::pitch>(v), J.dot(flat(v)) / k, 1e-12);
  EXPECT_NEAR(row.template speed<Joint::none>(v), (J.head<6>().dot(flat(v).head<6>())) / k, 1e-12);
  // Met in full, the demand leaves the speed that was wanted, softness aside.
  VelocityChange<double> u;
  row.template apply<Joint::pitch>(row.template demanded<Joint::pitch>(0.0, u), u);
  EXPECT_LT((flat(u) - 0.7 / k * response).norm(), 1e-14);
  EXPECT_NEAR(J.dot(flat(u)), 0.7 * (1 - softness / k), 1e-12);
}

TEST(ContactRows, AreTheirDenseJacobians) {
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  for (const double softness : {0.0, 0.002}) expect_dense(NormalRow{}, kPoint.cross(z), z, softness);
  expect_dense(SpinningRow{}, z, Eigen::Vector3d::Zero(), 0.0);
  expect_dense(Lateral1Row{}, kPoint.cross(-y), -y, 0.0);
  expect_dense(Lateral2Row{}, kPoint.cross(x), x, 0.0);
}

TEST(ContactRows, OnlyTheRowAlongXFeelsAMotor) {
  EXPECT_TRUE(Lateral2Row::feels(Joint::motor));
  EXPECT_FALSE(NormalRow::feels(Joint::motor) || SpinningRow::feels(Joint::motor) ||
               Lateral1Row::feels(Joint::motor));
  EXPECT_FALSE(Lateral2Row::feels(Joint::none));
}

TEST(ContactRows, AMotorGivesItsJointTheSpeedThatItWantsWithinItsLimit) {
  MotorRow row{1.0 / 2e5, 0.3, 5e4};
  VelocityChange<double> v;
  v.joint = 0.1;
  // 0.2 m/s of 2e5 kg.
  EXPECT_NEAR(row.demanded(1e3, v), 1e3 + 4e4, 1e-9);
  const double impulse = row.bounded(row.demanded(0.0, v));
  row.apply(impulse, v);
  EXPECT_NEAR(v.joint, 0.3, 1e-15);
  EXPECT_EQ(Eigen::Vector3d(v.angular), Eigen::Vector3d::Zero());
  EXPECT_EQ(Eigen::Vector3d(v.linear), Eigen::Vector3d::Zero());
  row.wanted = -0.5;
  EXPECT_EQ(row.bounded(row.demanded(0.0, v)), -5e4);
}

}  // namespace
}  // namespace vsr2
