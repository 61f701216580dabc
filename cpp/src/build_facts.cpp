#include "vsr2/build_facts.hpp"

#include <Eigen/Core>
#include <LinearMath/btScalar.h>

namespace vsr2 {

std::map<std::string, std::string> build_facts() {
  return {
      {"version", VSR2_VERSION},
      {"bullet", std::to_string(btGetVersion())},
      {"bullet_scalar_bytes", std::to_string(sizeof(btScalar))},
      {"eigen", std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION) + "." +
                    std::to_string(EIGEN_MINOR_VERSION)},
      {"compiler", __VERSION__},
      {"build_type", VSR2_BUILD_TYPE},
      {"sanitizers", VSR2_SANITIZE},
      {"sources", VSR2_SOURCES},
  };
}

}  // namespace vsr2
