#include "scenes.hpp"

#include <cmath>

namespace vsr2::testing {
namespace {

PedestalSpec prism(const ContactValues& material) {
  PedestalSpec pedestal;
  pedestal.parts = {BoxPart{{10, 10, 0.5}, {}}};
  pedestal.material = material;
  return pedestal;
}

}  // namespace

std::shared_ptr<const Scene> block_scene(const BlockOptions& options) {
  const Eigen::Vector3d& s = options.size;
  RockSpec rock;
  rock.parts = {BoxPart{s, {}}};
  rock.mass = options.density * s.prod();
  rock.principal_inertia = rock.mass / 12.0 *
                           Eigen::Vector3d(s.y() * s.y() + s.z() * s.z(), s.x() * s.x() + s.z() * s.z(),
                                           s.x() * s.x() + s.y() * s.y());
  rock.material = options.material;
  return std::make_shared<Scene>(options.engine, prism(options.material), rock);
}

std::shared_ptr<const Scene> hull_scene(int sides) {
  std::vector<Eigen::Vector3d> points;
  const Eigen::Vector3d half(0.2, 0.275, 0.475);
  if (sides == 0) {
    for (double x : {-1.0, 1.0})
      for (double y : {-1.0, 1.0})
        for (double z : {-1.0, 1.0}) points.push_back(half.cwiseProduct(Eigen::Vector3d(x, y, z)));
  } else {
    for (int i = 0; i < sides; ++i) {
      const double angle = 2 * M_PI * i / sides;
      for (double z : {-0.475, 0.475}) points.push_back({0.2 * std::cos(angle), 0.2 * std::sin(angle), z});
    }
  }
  // Given in a model frame that is not the body's: shifted and turned.
  const Pose X_MB{{0.1, -0.05, 0.3}, Eigen::Quaterniond(Eigen::AngleAxisd(0.4, Eigen::Vector3d(1, 2, 3).normalized()))};
  for (Eigen::Vector3d& p : points) p = X_MB.position + X_MB.orientation * p;
  RockSpec rock;
  rock.parts = {HullPart(points)};
  rock.mass = 500.0;
  rock.principal_inertia = sides == 0 ? Eigen::Vector3d(50.2, 44.3, 19.3) : Eigen::Vector3d(42.6, 42.6, 10.0);
  rock.X_MB = X_MB;
  return std::make_shared<Scene>(EngineSettings{}, prism({}), rock);
}

Pose standing(double height, double yaw) {
  return {{0, 0, 2.5 + height}, Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()))};
}

TrialSpec trial_of(std::shared_ptr<const Scene> scene, const Pose& start,
                   std::vector<double> position, Drive drive) {
  TrialSpec spec;
  spec.start = std::make_shared<SettledStart>(std::move(scene), drive, start, RestCriterion{}, 60.0, 0);
  spec.position = std::make_shared<const std::vector<double>>(std::move(position));
  return spec;
}

std::vector<double> cosine(double amplitude, double frequency) {
  std::vector<double> x;
  for (int i = 0; i <= static_cast<int>(std::ceil(1000.0 / frequency)); ++i) {
    const double t = std::min(i * 1e-3, 1.0 / frequency);
    x.push_back(amplitude * (1 - std::cos(2 * M_PI * frequency * t)));
  }
  return x;
}

}  // namespace vsr2::testing
