#pragma once
#include <memory>
#include <mutex>
#include <utility>
namespace realtime_tools
{
/// Two copies: the reader's, and the writer's, which change places when the reader finds news.
template <class T>
class RealtimeBuffer
{
public:
  T * readFromRT()
  {
    std::unique_lock<std::mutex> guard(mutex_, std::try_to_lock);
    if (guard.owns_lock() && std::exchange(news_, false)) {
      std::swap(read_, written_);
    }
    return read_.get();
  }

  void writeFromNonRT(const T & data)
  {
    std::lock_guard<std::mutex> guard(mutex_);
    *written_ = data;
    news_ = true;
  }

private:
  std::unique_ptr<T> read_ = std::make_unique<T>(), written_ = std::make_unique<T>();
  bool news_ = false;
  std::mutex mutex_;
};
}  // namespace realtime_tools
