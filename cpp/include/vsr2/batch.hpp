#pragma once
// Many independent trials on threads. Results do not depend on the number of threads or the order.

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "vsr2/trial.hpp"

namespace vsr2 {

/// A queue of trials and the threads that run them. It holds what waits, what runs and what was not
/// taken yet, so that whoever adds trials no faster than results are taken bounds its memory.
class Batch {
 public:
  /// At most `threads` trials run at a time. @throws InvalidInput if threads < 1.
  explicit Batch(int threads);
  /// Cancels and joins.
  ~Batch();
  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;

  /// Adds a trial, which may start at once. Returns its index: trials are counted from 0.
  /// @throws InvalidInput after close().
  std::size_t add(TrialSpec trial);
  /// No more trials come; the workers end with the last one.
  void close();
  /// Waits up to `timeout` [s] for finished trials and returns their indices (empty: none yet).
  std::vector<std::size_t> wait(double timeout);
  /// The batch is closed or cancelled, and wait() has returned all trials that ran.
  bool exhausted();
  /// Running trials stop within a few steps with status `cancelled`; no others begin.
  void cancel();
  /// Blocks until all workers have ended. Close or cancel first.
  void join();
  /// Moves out the result of a finished trial. @throws std::out_of_range if there is none.
  TrialResult take(std::size_t index);

 private:
  void work();

  const std::size_t threads_;
  std::vector<std::thread> workers_;
  std::atomic<bool> cancel_{false};
  std::mutex mutex_;
  std::condition_variable added_;
  std::condition_variable finished_;
  std::deque<std::pair<std::size_t, TrialSpec>> waiting_;
  std::unordered_map<std::size_t, TrialResult> results_;
  std::vector<std::size_t> ready_;
  std::size_t next_ = 0;
  std::size_t running_ = 0;
  bool closed_ = false;
};

}  // namespace vsr2
