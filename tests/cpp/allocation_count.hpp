#pragma once

namespace vsr2::test {
/// Allocations of this program so far, by operator new and by Bullet.
long allocation_count();
/// Counts Bullet's allocations from now on.
void count_bullet_allocations();
}  // namespace vsr2::test
