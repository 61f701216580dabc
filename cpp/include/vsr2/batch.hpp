#pragma once
// Many independent trials on threads. Results do not depend on the number of threads or the order.

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <mutex>
#include <thread>
#include <vector>

#include "vsr2/trial.hpp"

namespace vsr2 {

class Batch {
 public:
  /// Starts `threads` workers at once. @throws InvalidInput if threads < 1.
  Batch(std::vector<TrialSpec> trials, int threads);
  /// Cancels and joins.
  ~Batch();
  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;

  std::size_t size() const { return trials_.size(); }
  /// Waits up to `timeout` [s] for finished trials and returns their indices (empty: none yet).
  std::vector<std::size_t> wait(double timeout);
  /// All trials were handed out by wait().
  bool exhausted();
  /// Running trials stop within a few steps with status `cancelled`; the rest stay `not_run`.
  void cancel();
  /// Blocks until all workers have ended.
  void join();
  /// Moves out the result of a finished trial.
  TrialResult take(std::size_t index);

 private:
  void work();

  std::vector<TrialSpec> trials_;
  std::vector<TrialResult> results_;
  std::vector<std::thread> workers_;
  std::atomic<std::size_t> next_{0};
  std::atomic<bool> cancel_{false};
  std::mutex mutex_;
  std::condition_variable finished_;
  std::vector<std::size_t> ready_;
  std::size_t handed_out_ = 0;
  int running_ = 0;
};

}  // namespace vsr2
