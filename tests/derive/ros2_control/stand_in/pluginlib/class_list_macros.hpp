#pragma once
#include <memory>

// Here: a function that makes the one plugin of the program, and a proof that it is of its base.
#define PLUGINLIB_EXPORT_CLASS(Derived, Base) \
  std::shared_ptr<Base> make_plugin();        \
  std::shared_ptr<Base> make_plugin()         \
  {                                           \
    return std::make_shared<Derived>();       \
  }
