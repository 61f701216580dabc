#pragma once
#include <map>
#include <string>

namespace vsr2 {
/// What this library was built from: version, Bullet, Eigen, compiler, scalar width, sanitizers, and the
/// SHA-256 of its sources and their names.
std::map<std::string, std::string> build_facts();
}  // namespace vsr2
