// Small stages whose content follows from their key, to recognise them whole.
#pragma once

#include <boost/make_shared.hpp>
#include <cstdint>
#include <string>

#include "cortshift_tracking/case/durable_file.hpp"
#include "cortshift_tracking/case/stage_store.hpp"

namespace cortshift_tracking {

inline StageRecord sampleStage(const std::string& key, std::uint32_t bytes = 300000) {
  const auto surface = boost::make_shared<sensor_msgs::PointCloud2>();
  surface->header.frame_id = "pmr";
  surface->header.stamp = ros::Time(1700000000 + crc32(key.data(), key.size()) % 1000, 250000000);
  surface->width = bytes / 20;
  surface->height = 1;
  surface->point_step = 20;
  surface->row_step = surface->width * 20;
  surface->data.resize(surface->row_step);
  std::uint32_t state = crc32(key.data(), key.size());
  for (std::uint8_t& byte : surface->data) {
    state = state * 1664525U + 1013904223U;
    byte = static_cast<std::uint8_t>(state >> 24);
  }
  StageRecord record;
  record.surface = surface;
  record.info.key = key;
  record.info.note = "note of " + key;
  record.info.stamp = surface->header.stamp;
  record.info.valid_points = surface->width;
  record.info.coverage = 0.5;
  return record;
}

inline bool isWhole(const StageRecord& record) {
  const StageRecord expected = sampleStage(record.info.key, static_cast<std::uint32_t>(record.surface->data.size()));
  return record.surface->data == expected.surface->data && record.info.note == expected.info.note &&
         record.info.stamp == expected.info.stamp;
}

}  // namespace cortshift_tracking
