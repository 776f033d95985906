#include "cortshift_tracking/ros/bridge/bridge_parameters.hpp"

#include "cortshift_stereo/ros/parameter_reader.hpp"

namespace cortshift_tracking::igt {
namespace {

ToolSettings toolFromYaml(XmlRpc::XmlRpcValue& entry) {
  const auto fail = [](const std::string& what) {
    throw cortshift_stereo::ParameterError(
        "tools: each entry is {device: TEXT, parent: TEXT, child: TEXT, latency: S}; " + what);
  };
  if (entry.getType() != XmlRpc::XmlRpcValue::TypeStruct) fail("this one is no such list of keys");
  ToolSettings tool;
  for (auto& [key, value] : entry) {
    if (key == "latency") {
      if (value.getType() != XmlRpc::XmlRpcValue::TypeDouble) fail("latency must be a number with a point, in seconds");
      tool.latency = static_cast<double>(value);
    } else if (key == "device" || key == "parent" || key == "child") {
      if (value.getType() != XmlRpc::XmlRpcValue::TypeString) fail(key + " must be a text");
      (key == "device" ? tool.device : key == "parent" ? tool.parent : tool.child) = static_cast<std::string>(value);
    } else {
      fail("key '" + key + "' is unknown");
    }
  }
  return tool;
}

}  // namespace

BridgeParameters readBridgeParameters(const ros::NodeHandle& node) {
  BridgeParameters p;
  cortshift_stereo::ParameterReader reader(node);
  reader.flag("listen", p.endpoint.listen);
  reader.choice("listen_address", p.endpoint.listen_address);
  reader.number("listen_port", p.endpoint.listen_port, 0, 65535);
  reader.texts("allowed_peers", p.endpoint.allowed_peers);
  reader.texts("servers", p.endpoint.servers);
  reader.number("max_clients", p.endpoint.max_clients, 1, 100);
  reader.number("max_message_bytes", p.endpoint.max_message_bytes, 1024, 256 << 20);
  reader.number("message_timeout", p.endpoint.message_timeout, 0.1, 60.0);
  reader.number("send_timeout", p.endpoint.send_timeout, 0.1, 600.0);
  reader.number("reconnect_min", p.endpoint.reconnect_min, 0.05, 60.0);
  reader.number("reconnect_max", p.endpoint.reconnect_max, 0.05, 600.0);
  reader.choice("pmr_axes", p.pmr_axes, {"ras", "lps"});
  reader.choice("link_axes", p.link_axes, {"ras", "lps"});
  reader.number("stale_after", p.board.stale_after, 0.01, 10.0);
  reader.number("max_clock_offset", p.board.max_clock_offset, 0.001, 3600.0);
  reader.number("same_time", p.board.same_time, 0.0, 0.1);
  reader.number("field_spacing", p.field_spacing, 0.00005, 0.01);
  reader.number("surface_period", p.surface_period, 0.05, 3600.0);
  reader.number("surface_step", p.surface_step, 1, 100);
  reader.choice("vtk_folder", p.vtk_folder);
  reader.choice("command_device", p.command_device);
  reader.number("stage_poll_period", p.stage_poll_period, 0.1, 60.0);
  reader.number("request_tracking_ms", p.request_tracking_ms, 0, 1000);
  reader.choice("launch", p.launch);
  XmlRpc::XmlRpcValue tools;
  reader.structure("tools", tools);
  reader.finish();
  if (tools.valid()) {
    if (tools.getType() != XmlRpc::XmlRpcValue::TypeArray)
      throw cortshift_stereo::ParameterError("tools must be a list");
    for (int i = 0; i < tools.size(); ++i) p.board.tools.push_back(toolFromYaml(tools[i]));
  }
  p.endpoint.validate();
  p.board.validate();
  return p;
}

}  // namespace cortshift_tracking::igt
