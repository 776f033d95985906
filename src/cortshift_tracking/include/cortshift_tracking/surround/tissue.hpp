// What a piece of surface looks like: bone, cloth, or tissue with blood in it.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "cortshift_tracking/field/displacement_field.hpp"

namespace cortshift_tracking {

enum class Tissue : uchar {
  kNone,   ///< nothing is seen or reported there
  kPale,   ///< bone; also metal, cotton and white cloth
  kCloth,  ///< green or blue: a drape
  kFlesh   ///< brain, dura, skin, blood
};

/// A square of the field's grid.
struct Piece {
  cv::Point cell;                   ///< of the image of pieces
  Eigen::Vector3d place_pmr;        ///< mean of the starts [m]
  Eigen::Vector3d motion_pmr;       ///< mean displacement [m]
  double spread = 0;                ///< mean square distance of the displacements from it [m^2]
  float redness = 0, pinkness = 0;  ///< log R/G, and log RB/G^2
};

/// The field in squares of about 2 mm; those of which less than half is reported are left out.
struct Pieces {
  double side = 0;  ///< of a square [m]
  cv::Size size;    ///< of the image of pieces
  std::vector<Piece> all;
};

Pieces piecesOf(const DisplacementField& field);

/// Blood absorbs green light: what it runs through is redder than green, and its green lies below the middle of red and
/// blue. Bone, metal and cotton have no such dip, whatever the colour of the light is within a fifth of white.
/// @param redness log R/G  @param pinkness log RB/G^2, both as means over an area
Tissue tissueOfColour(float redness, float pinkness);

/// CV_8UC1 of Tissue over the image of pieces.
cv::Mat tissueOf(const Pieces& pieces);

/// Where `tissue` is kPale and not enclosed by flesh: what lies on the brain (cotton, a retractor's tip) is enclosed.
cv::Mat paleAround(const cv::Mat& tissue);

}  // namespace cortshift_tracking
