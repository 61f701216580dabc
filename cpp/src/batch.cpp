#include "vsr2/batch.hpp"

#include <algorithm>
#include <chrono>
#include <string>

namespace vsr2 {

Batch::Batch(std::vector<TrialSpec> trials, int threads)
    : trials_(std::move(trials)), results_(trials_.size()) {
  if (threads < 1) throw InvalidInput("threads must be at least 1, got " + std::to_string(threads));
  ready_.reserve(trials_.size());
  running_ = static_cast<int>(std::min<std::size_t>(threads, std::max<std::size_t>(trials_.size(), 1)));
  workers_.reserve(running_);
  for (int i = 0, n = running_; i < n; ++i) workers_.emplace_back([this] { work(); });
}

Batch::~Batch() {
  cancel();
  join();
}

void Batch::work() {
  while (!cancel_.load(std::memory_order_relaxed)) {
    const std::size_t index = next_.fetch_add(1, std::memory_order_relaxed);
    if (index >= trials_.size()) break;
    TrialResult result = run_trial(trials_[index], cancel_);
    {
      const std::lock_guard lock(mutex_);
      results_[index] = std::move(result);
      ready_.push_back(index);
    }
    finished_.notify_one();
  }
  {
    const std::lock_guard lock(mutex_);
    --running_;
  }
  finished_.notify_all();
}

std::vector<std::size_t> Batch::wait(double timeout) {
  std::unique_lock lock(mutex_);
  finished_.wait_for(lock, std::chrono::duration<double>(timeout),
                     [this] { return !ready_.empty() || running_ == 0; });
  std::vector<std::size_t> out;
  out.swap(ready_);
  handed_out_ += out.size();
  return out;
}

bool Batch::exhausted() {
  const std::lock_guard lock(mutex_);
  return running_ == 0 && ready_.empty();
}

void Batch::cancel() { cancel_.store(true, std::memory_order_relaxed); }

void Batch::join() {
  for (std::thread& worker : workers_)
    if (worker.joinable()) worker.join();
}

TrialResult Batch::take(std::size_t index) {
  const std::lock_guard lock(mutex_);
  return std::move(results_.at(index));
}

}  // namespace vsr2
