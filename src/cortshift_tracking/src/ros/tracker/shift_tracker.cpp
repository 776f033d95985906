#include "cortshift_tracking/ros/tracker/shift_tracker.hpp"

namespace cortshift_tracking {

ShiftTracker::Lane::Lane(const ros::NodeHandle& handle, unsigned int threads) : node(handle), spinner(threads, &queue) {
  node.setCallbackQueue(&queue);
}

// Of two captures one waits and the other is refused; of two shifts the second waits; live mode may take a while to
// end.
ShiftTracker::ShiftTracker(const ShiftTrackerParameters& parameters, const ros::NodeHandle& private_node)
    : data_(ros::NodeHandle(), 2),
      captures_(private_node, 2),
      computing_(private_node, 2),
      questions_(private_node, 2),
      case_(parameters),
      placement_(parameters, data_.node),
      feed_(data_.node),
      pairs_(data_.node),
      publisher_(parameters, data_.node),
      capturing_(parameters, case_, placement_, feed_, pairs_, activity_, data_.node, captures_.node),
      shifts_(parameters, case_, feed_, publisher_, activity_, computing_.node),
      services_(case_, questions_.node),
      live_(parameters, case_, placement_, feed_, pairs_, publisher_, activity_, questions_.node),
      health_(parameters, case_, placement_, feed_, activity_, live_, data_.node) {
  // Only now: a request finds everything in place.
  for (Lane* lane : {&data_, &captures_, &computing_, &questions_}) lane->spinner.start();
}

ShiftTracker::~ShiftTracker() {
  for (Lane* lane : {&questions_, &computing_, &captures_, &data_}) lane->spinner.stop();
}

}  // namespace cortshift_tracking
