// DisplacementField and Summary as messages and back.
#pragma once

#include <cortshift_msgs/DisplacementField.h>
#include <cortshift_msgs/ShiftSummary.h>
#include <cortshift_msgs/StageInfo.h>
#include <geometry_msgs/Polygon.h>

#include "cortshift_tracking/shift.hpp"

namespace cortshift_tracking {

/// Corners in a projection frame [m]; z is left out.
Region regionFromMessage(const geometry_msgs::Polygon& polygon);

cortshift_msgs::ShiftSummary toMessage(const Summary& summary, const std::string& from_key, const std::string& to_key);

/// All but how the time was spent.
Summary summaryFromMessage(const cortshift_msgs::ShiftSummary& message);

cortshift_msgs::DisplacementField toMessage(const DisplacementField& field, const Summary& summary,
                                            const cortshift_msgs::StageInfo& from, const cortshift_msgs::StageInfo& to);

/// The paper's alternative sampling: the earlier surface's own points with their displacements, organised as that
/// surface: float32 x y z dx dy dz confidence, NaN where not trusted.
sensor_msgs::PointCloud2 ownPointsMessage(const ShiftResult& result, const std_msgs::Header& header);

/// The field of a message, from any writer that keeps the contract.
/// @throws cortshift_stereo::MessageError naming what is wrong
DisplacementField fieldFromMessage(const cortshift_msgs::DisplacementField& message);

}  // namespace cortshift_tracking
