#include "cortshift_tracking/ros/tracker/case_services.hpp"

#include <ros/console.h>

#include <ctime>
#include <functional>

#include "cortshift_tracking/case/durable_file.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/ros/field_message.hpp"

namespace cortshift_tracking {
namespace {

/// @param action  does what is asked and says so; what it throws becomes the refusal
template <typename Response>
bool answer(Response& response, const char* service, const std::function<std::string()>& action) {
  try {
    response.message = action();
    response.success = true;
    ROS_INFO_STREAM(response.message);
  } catch (const std::exception& error) {
    response.success = false;
    response.message = error.what();
    ROS_WARN_STREAM(service << " refused: " << response.message);
  }
  return true;
}

std::vector<Region> regionsFrom(const std::vector<geometry_msgs::Polygon>& polygons) {
  std::vector<Region> regions;
  for (const geometry_msgs::Polygon& polygon : polygons) regions.push_back(regionFromMessage(polygon));
  return regions;
}

/// "2026-11-26T14:13:07Z", wall time.
std::string utc(const ros::WallTime& time) {
  const std::time_t seconds = time.sec;
  std::tm fields{};
  gmtime_r(&seconds, &fields);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &fields);
  return text;
}

/// Adds a line to the case's log; it is on the disk when this returns. @throws TrackingError
void log(const std::filesystem::path& folder, const std::string& line) {
  const std::string text = utc(ros::WallTime::now()) + " " + line + "\n";
  appendDurably(folder / "case_log.txt", text.data(), text.size());
}

}  // namespace

CaseServices::CaseServices(OpenCase& open, ros::NodeHandle& services)
    : case_(open),
      list_(services.advertiseService("list_stages", &CaseServices::onList, this)),
      delete_(services.advertiseService("delete_stage", &CaseServices::onDelete, this)),
      set_gravity_(services.advertiseService("set_gravity", &CaseServices::onGravity, this)),
      exclude_(services.advertiseService("exclude_regions", &CaseServices::onExclude, this)),
      outline_(services.advertiseService("set_outline", &CaseServices::onOutline, this)) {}

bool CaseServices::onList(cortshift_msgs::ListStages::Request&, cortshift_msgs::ListStages::Response& response) {
  case_.store.retryUnreadable();
  response.stages = case_.store.list();
  return true;
}

bool CaseServices::onDelete(DeleteEvent& event) {
  const cortshift_msgs::DeleteStage::Request& request = event.getRequest();
  return answer(event.getResponse(), "delete_stage", [&] {
    std::string captured = "that cannot be read";
    for (const cortshift_msgs::StageInfo& stage : case_.store.list())
      if (stage.key == request.key && !stage.stamp.isZero())
        captured = "captured " + utc(ros::WallTime(stage.stamp.sec, stage.stamp.nsec));
    case_.store.remove(request.key);
    std::string message = "stage '" + request.key + "' is deleted";
    try {
      log(case_.store.folder(),
          "deleted stage '" + request.key + "', " + captured + ", asked by " + event.getCallerName());
    } catch (const TrackingError& error) {  // the stage is gone all the same
      message += "; but its log does not say so: " + std::string(error.what());
    }
    try {
      case_.state.forget(request.key);
    } catch (
        const TrackingError& error) {  // kept regions name the capture that they belong to: no other will have them
      message += "; what was excluded from it is still on the disk: " + std::string(error.what());
    }
    return message;
  });
}

bool CaseServices::onGravity(cortshift_msgs::SetGravity::Request& request,
                             cortshift_msgs::SetGravity::Response& response) {
  return answer(response, "set_gravity", [&] {
    const auto down = unitVector({request.gravity.x, request.gravity.y, request.gravity.z});
    if (!down) throw TrackingError("gravity is not a direction; give a finite vector in pmr that points down");
    case_.state.setGravity(*down, "the service set_gravity, kept with the case");
    return std::string("gravity is set and kept with the case; it counts from the next shift on");
  });
}

bool CaseServices::onExclude(cortshift_msgs::ExcludeRegions::Request& request,
                             cortshift_msgs::ExcludeRegions::Response& response) {
  return answer(response, "exclude_regions", [&] {
    const cortshift_msgs::StageInfo stage = case_.store.load(request.key).info;
    case_.state.exclude(stage, regionsFrom(request.polygons));
    return std::to_string(request.polygons.size()) + " regions are excluded from shifts that start at '" + request.key +
           "'";
  });
}

bool CaseServices::onOutline(cortshift_msgs::SetOutline::Request& request,
                             cortshift_msgs::SetOutline::Response& response) {
  return answer(response, "set_outline", [&] {
    const cortshift_msgs::StageInfo stage = case_.store.load(request.key).info;
    case_.state.setOutline(stage, regionsFrom(request.brain));
    return request.brain.empty() ? "the outline of the brain on '" + request.key + "' is no longer the drawn one"
                                 : "the outline of the brain on '" + request.key +
                                       "' is set and kept with the case; it counts from the next shift on";
  });
}

}  // namespace cortshift_tracking
