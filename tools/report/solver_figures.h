// The figures of the solvers' evaluation in the paper's layout: rotation beside translation error
// over the noise, one curve a method; the inlier ratio for relative poses; the Cramer-Rao bound.
#pragma once

#include <string>

#include "tools/evaluation/solver_evaluation.h"

namespace rsfm {

// A complete SVG document.
std::string SolverFigureSvg(const SolverEvaluation& evaluation);

}  // namespace rsfm
