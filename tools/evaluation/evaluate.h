// How good a reconstruction is against its ground truth: the measures of the paper's Table I.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rsfm/io/model.h"
#include "rsfm/io/trajectory.h"
#include "tools/evaluation/alignment.h"
#include "tools/evaluation/ground_truth.h"
#include "tools/offline/bend.h"
#include "tools/offline/image_navigation.h"

namespace rsfm {

struct Evaluation {
  int num_images = 0;     // compared
  int num_unmatched = 0;  // of the reconstruction, without a ground truth
  Similarity truth_from_estimate;
  std::optional<double> rotation_error_deg;  // mean over images
  double position_error_mm = 0.0;            // mean over images
  double position_rmse_mm = 0.0;             // root mean square over images
  double position_max_mm = 0.0;
  double distance_m = 0.0;  // of the true way from image to image, in the estimate's order
  std::optional<double> reprojection_error_px;  // mean over observations
  std::optional<double> point_error_mm;         // mean distance of the points to the mesh
  std::optional<double> point_error_median_mm;
  // Of the points, cameras looking one way: what they bend more than the mesh does where there is
  // one, else what they bend. 0 of a seafloor that is flat and mapped as such.
  std::optional<Bend> bend;
};

// Images are matched by TruthIndex.
IoExpected<Evaluation> Evaluate(const Model& model, const std::vector<TrajectoryPose>& estimate,
                                const GroundTruth& truth, Alignment alignment);

// How good dead reckoning alone would have been over the same images. None where navigation does
// not span them, or nothing is aligned: where it starts is not known.
std::optional<Evaluation> EvaluateDeadReckoning(const ImageNavigation& at_images,
                                                const std::vector<TrajectoryPose>& estimate,
                                                const GroundTruth& truth, Alignment alignment);

// Mean distance in the image between observed features and their points' exact projections; none
// where there is no observation. A point that cannot be projected is left out.
std::optional<double> MeanReprojectionError(const Model& model);

}  // namespace rsfm
