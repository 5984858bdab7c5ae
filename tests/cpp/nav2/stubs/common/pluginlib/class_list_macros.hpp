// Stub of pluginlib/class_list_macros.hpp: the plugin is made by stub_plugin().
#ifndef PLUGINLIB_STUB_HPP
#define PLUGINLIB_STUB_HPP

#include <memory>

#define PLUGINLIB_EXPORT_CLASS(Plugin, Base) \
  std::shared_ptr<Base> stub_plugin() { return std::make_shared<Plugin>(); }

#endif
