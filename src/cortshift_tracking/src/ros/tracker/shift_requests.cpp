#include "cortshift_tracking/ros/tracker/shift_requests.hpp"

#include <ros/console.h>

#include "cortshift_stereo/provenance.hpp"
#include "cortshift_tracking/case/stage_key.hpp"
#include "cortshift_tracking/ros/field_message.hpp"
#include "cortshift_tracking/ros/mr_shift.hpp"

namespace cortshift_tracking {
namespace {

using Request = cortshift_msgs::ComputeShift::Request;
using Response = cortshift_msgs::ComputeShift::Response;

}  // namespace

ShiftRequests::ShiftRequests(const ShiftTrackerParameters& parameters, OpenCase& open, const SurfaceFeed& feed,
                             FieldPublisher& publisher, Activity& activity, ros::NodeHandle& services)
    : settings_(parameters.shift),
      configuration_([parameters, &feed] {
        return cortshift_stereo::sha256(parameters.configuration(feed.reconstructionParameters()));
      }),
      case_(open),
      publisher_(publisher),
      activity_(activity) {
  const auto service = [&](const char* name, bool across_epochs) {
    return services.advertiseService<Request, Response>(
        name, boost::function<bool(Request&, Response&)>([this, across_epochs](Request& request, Response& response) {
          return compute(request, response, across_epochs);
        }));
  };
  compute_ = service("compute_shift", false);
  compute_across_epochs_ = service("compute_shift_across_epochs", true);
}

bool ShiftRequests::compute(const Request& request, Response& response, bool across_epochs) {
  try {
    const std::lock_guard<std::mutex> guard(case_.computing);
    const auto gravity = case_.state.gravity();
    const auto gravity_pmr = gravity ? std::make_optional(gravity->direction_pmr) : std::nullopt;
    const auto stages = case_.store.list();
    const Drawn drawn{case_.state.regions(stages), case_.state.outlines(stages)};
    ShiftSettings settings = settings_;
    settings.configuration = configuration_();
    const StageShift shift = request.from_key == kMrKey
                                 ? computeMrShift(case_.store, request.to_key, case_.first_normal, gravity_pmr,
                                                  settings, drawn, across_epochs)
                                 : computeStageShift(case_.store, request.from_key, request.to_key, case_.first_normal,
                                                     gravity_pmr, settings, drawn, across_epochs);
    publisher_.publish(shift.result, {case_.first_normal.of(case_.store), gravity_pmr}, shift.from, shift.to, false);
    response.success = true;
    response.summary = toMessage(shift.result.summary, request.from_key, request.to_key);
    response.message = "shift " + request.from_key + " to " + request.to_key + ": " + toText(shift.result.summary);
    const std::string trouble = case_.state.trouble();
    if (!trouble.empty()) response.message += "; " + trouble;
    ROS_INFO_STREAM(response.message);
    activity_.computed(response.message);
  } catch (const std::exception& error) {
    response.success = false;
    response.message = "no shift from '" + request.from_key + "' to '" + request.to_key + "': " + error.what();
    ROS_WARN_STREAM("compute_shift refused: " << response.message);
    activity_.refused(response.message);
  }
  return true;
}

}  // namespace cortshift_tracking
