#include "vsr2/batch.hpp"

#include <chrono>
#include <optional>
#include <stdexcept>
#include <string>

namespace vsr2 {
namespace {

std::size_t checked(int threads) {
  if (threads < 1) throw InvalidInput("threads must be at least 1, got " + std::to_string(threads));
  return static_cast<std::size_t>(threads);
}

}  // namespace

Batch::Batch(int threads) : threads_(checked(threads)) { workers_.reserve(threads_); }

Batch::~Batch() {
  cancel();
  join();
}

std::size_t Batch::add(TrialSpec trial) {
  std::size_t index = 0;
  {
    const std::lock_guard lock(mutex_);
    if (closed_) throw InvalidInput("the batch is closed");
    index = next_++;
    waiting_.emplace_back(index, std::move(trial));
    if (workers_.size() < threads_ && !cancel_.load(std::memory_order_relaxed)) {
      workers_.emplace_back([this] { work(); });
      ++running_;
    }
  }
  added_.notify_one();
  return index;
}

void Batch::close() {
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
  }
  added_.notify_all();
}

void Batch::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    added_.wait(lock, [this] {
      return !waiting_.empty() || closed_ || cancel_.load(std::memory_order_relaxed);
    });
    if (waiting_.empty() || cancel_.load(std::memory_order_relaxed)) break;
    const std::size_t index = waiting_.front().first;
    std::optional<TrialSpec> trial = std::move(waiting_.front().second);
    waiting_.pop_front();
    lock.unlock();
    TrialResult result = run_trial(*trial, cancel_);
    // What it borrowed may be Python's: it goes before the lock, which Python's threads wait for.
    trial.reset();
    lock.lock();
    results_.emplace(index, std::move(result));
    ready_.push_back(index);
    finished_.notify_one();
  }
  --running_;
  finished_.notify_all();
}

std::vector<std::size_t> Batch::wait(double timeout) {
  std::unique_lock lock(mutex_);
  finished_.wait_for(lock, std::chrono::duration<double>(timeout),
                     [this] { return !ready_.empty() || running_ == 0; });
  std::vector<std::size_t> out;
  out.swap(ready_);
  return out;
}

bool Batch::exhausted() {
  const std::lock_guard lock(mutex_);
  const bool ends = closed_ || cancel_.load(std::memory_order_relaxed);
  return ends && running_ == 0 && ready_.empty();
}

void Batch::cancel() {
  {
    // Under the lock, so that a worker that is about to wait cannot miss it.
    const std::lock_guard lock(mutex_);
    cancel_.store(true, std::memory_order_relaxed);
  }
  added_.notify_all();
}

void Batch::join() {
  for (std::thread& worker : workers_)
    if (worker.joinable()) worker.join();
}

TrialResult Batch::take(std::size_t index) {
  const std::lock_guard lock(mutex_);
  const auto found = results_.find(index);
  if (found == results_.end())
    throw std::out_of_range("trial " + std::to_string(index) + " has no result to take");
  TrialResult result = std::move(found->second);
  results_.erase(found);
  return result;
}

}  // namespace vsr2
