#include "cortshift_stereo/ros/static_transforms.hpp"

#include <yaml-cpp/yaml.h>

#include <array>
#include <cmath>
#include <set>

namespace cortshift_stereo {
namespace {

template <std::size_t n>
std::array<double, n> numbers(const YAML::Node& entry, const char* key, const std::string& where) {
  std::array<double, n> out{};
  const YAML::Node list = entry[key];
  bool good = list.IsSequence() && list.size() == n;
  for (std::size_t i = 0; good && i < n; ++i)
    good = YAML::convert<double>::decode(list[i], out[i]) && std::isfinite(out[i]);
  if (!good) throw StaticTransformsError(where + ": " + key + " must be " + std::to_string(n) + " numbers");
  return out;
}

geometry_msgs::TransformStamped transformFromYaml(const YAML::Node& entry, const std::string& where) {
  std::set<std::string> keys;
  if (entry.IsMap())
    for (const auto& pair : entry) keys.insert(pair.first.as<std::string>());
  if (keys != std::set<std::string>{"parent", "child", "translation", "rotation"})
    throw StaticTransformsError(where + ": needs exactly the keys child, parent, rotation, translation");
  geometry_msgs::TransformStamped out;
  out.header.frame_id = entry["parent"].as<std::string>();
  out.child_frame_id = entry["child"].as<std::string>();
  const std::string edge = where + " (" + out.header.frame_id + " -> " + out.child_frame_id + ")";
  const auto t = numbers<3>(entry, "translation", edge);
  const auto q = numbers<4>(entry, "rotation", edge);
  const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (!(std::abs(norm - 1) <= 1e-4))
    throw StaticTransformsError(edge + ": rotation has length " + std::to_string(norm) + ", not 1");
  out.transform.translation.x = t[0];
  out.transform.translation.y = t[1];
  out.transform.translation.z = t[2];
  out.transform.rotation.x = q[0];
  out.transform.rotation.y = q[1];
  out.transform.rotation.z = q[2];
  out.transform.rotation.w = q[3];
  return out;
}

}  // namespace

std::vector<geometry_msgs::TransformStamped> readStaticTransforms(const std::string& path) {
  try {
    const YAML::Node root = YAML::LoadFile(path);
    if (!root.IsSequence() || root.size() == 0) throw StaticTransformsError(path + ": expected a list of transforms");
    std::vector<geometry_msgs::TransformStamped> out;
    for (std::size_t i = 0; i < root.size(); ++i)
      out.push_back(transformFromYaml(root[i], path + ": transform " + std::to_string(i + 1)));
    return out;
  } catch (const YAML::Exception& error) {
    throw StaticTransformsError(path + " cannot be read as a list of transforms: " + error.what());
  }
}

std::string staticTransformsToYaml(const std::vector<geometry_msgs::TransformStamped>& transforms) {
  YAML::Emitter out;
  out.SetDoublePrecision(17);
  out << YAML::BeginSeq;
  for (const geometry_msgs::TransformStamped& transform : transforms) {
    const auto& t = transform.transform.translation;
    const auto& q = transform.transform.rotation;
    out << YAML::BeginMap << YAML::Key << "parent" << YAML::Value << transform.header.frame_id;
    out << YAML::Key << "child" << YAML::Value << transform.child_frame_id;
    out << YAML::Key << "translation" << YAML::Value << YAML::Flow << std::vector<double>{t.x, t.y, t.z};
    out << YAML::Key << "rotation" << YAML::Value << YAML::Flow << std::vector<double>{q.x, q.y, q.z, q.w}
        << YAML::EndMap;
  }
  out << YAML::EndSeq;
  return out.c_str() + std::string("\n");
}

}  // namespace cortshift_stereo
