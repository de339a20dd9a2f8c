// A timer queue without a thread: the harness owns the time and fires what is due.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <functional>
#include <vector>

namespace BT
{
// All timers of the process, in the order in which they were begun.
class SimulatedTime
{
public:
  struct Timer
  {
    int64_t due_ms;
    uint64_t id;
    const void* owner;
    std::function<void(bool)> handler;
  };

  static SimulatedTime& instance()
  {
    static SimulatedTime time;
    return time;
  }

  uint64_t add(const void* owner, int64_t after_ms, std::function<void(bool)> handler)
  {
    timers_.push_back({ now_ms_ + after_ms, ++last_id_, owner, std::move(handler) });
    return last_id_;
  }

  // Cancelled timers call their handlers at once, as the thread does "immediately".
  size_t cancel(const void* owner, uint64_t id)
  {
    size_t cancelled = 0;
    for(;;)
    {
      auto it = std::find_if(timers_.begin(), timers_.end(), [&](const Timer& timer) {
        return timer.owner == owner && (id == 0 || timer.id == id);
      });
      if(it == timers_.end())
      {
        return cancelled;
      }
      auto handler = std::move(it->handler);
      timers_.erase(it);
      cancelled++;
      handler(true);
    }
  }

  void forget_timers()
  {
    timers_.clear();
  }

  int64_t now_ms() const
  {
    return now_ms_;
  }

  void advance(int64_t by_ms)
  {
    const int64_t until_ms = now_ms_ + by_ms;
    for(;;)
    {
      auto it = std::min_element(timers_.begin(), timers_.end(),
                                 [](const Timer& a, const Timer& b) {
                                   return a.due_ms != b.due_ms ? a.due_ms < b.due_ms :
                                                                 a.id < b.id;
                                 });
      if(it == timers_.end() || it->due_ms > until_ms)
      {
        break;
      }
      now_ms_ = std::max(now_ms_, it->due_ms);
      auto handler = std::move(it->handler);
      timers_.erase(it);
      handler(false);
    }
    now_ms_ = until_ms;
  }

private:
  int64_t now_ms_ = 0;
  uint64_t last_id_ = 0;
  std::vector<Timer> timers_;
};

template <typename ClockT = std::chrono::steady_clock,
          typename DurationT = std::chrono::steady_clock::duration>
class TimerQueue
{
public:
  TimerQueue() = default;
  ~TimerQueue()
  {
    cancelAll();
  }

  uint64_t add(std::chrono::milliseconds after, std::function<void(bool)> handler)
  {
    return SimulatedTime::instance().add(this, after.count(), std::move(handler));
  }

  size_t cancel(uint64_t id)
  {
    return id == 0 ? 0 : SimulatedTime::instance().cancel(this, id);
  }

  size_t cancelAll()
  {
    return SimulatedTime::instance().cancel(this, 0);
  }

  TimerQueue(const TimerQueue&) = delete;
  TimerQueue& operator=(const TimerQueue&) = delete;
};
}  // namespace BT
