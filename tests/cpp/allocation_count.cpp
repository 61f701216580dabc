#include "allocation_count.hpp"

#include <atomic>
#include <cstdlib>
#include <new>

#include <LinearMath/btAlignedAllocator.h>

namespace {

std::atomic<long> allocations{0};

void* counted_malloc(std::size_t size) {
  allocations.fetch_add(1, std::memory_order_relaxed);
  return std::malloc(size > 0 ? size : 1);
}

}  // namespace

void* operator new(std::size_t size) {
  if (void* memory = counted_malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace vsr2::test {

long allocation_count() { return allocations.load(); }
void count_bullet_allocations() { btAlignedAllocSetCustom(counted_malloc, std::free); }

}  // namespace vsr2::test
