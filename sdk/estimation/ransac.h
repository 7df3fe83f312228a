// LO-RANSAC, once, for every estimator.
//
// Hypotheses from minimal samples are ranked by a truncated sum of their errors (ransac_scoring.h);
// each new best is locally optimised on its inliers [Chum 2003, DAGM; Lebeda 2012, BMVC]; sampling
// stops when a better sample has been missed with a probability below 1 - confidence [Fischler &
// Bolles 1981], or at a bound.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>
#include <span>

#include "rsfm/base/error.h"
#include "rsfm/base/fixed_vector.h"
#include "rsfm/base/rng.h"
#include "rsfm/estimation/ransac_scoring.h"

namespace rsfm {

struct RansacOptions {
  double max_error_px = 2.0;   // the inlier threshold, in the unit of the problem's error
  double confidence = 0.9999;  // in (0, 1)
  int min_iterations = 10;
  int max_iterations = 1000;  // the latency bound: the worst case is this many solves ...
  // ... and this many evaluations of one observation against one model, checked after each sample
  std::int64_t max_evaluations = 4'000'000;
  int max_refinements = 4;  // local optimisations of one hypothesis; 0 is plain MSAC
  std::uint64_t seed = 1;   // always explicit: a replay repeats bit for bit
  RansacScoring scoring = RansacScoring::kMsac;
  // The observations come best first (by matching score, say): good ones are sampled earlier, and
  // it may be enough that the better ones agree (PROSAC). Wrong orders only cost time.
  bool sorted_by_quality = false;
  // Asked after each sample with its context; true ends the sampling with what there is: a time
  // budget. A run that it ends repeats only if it answers the same.
  bool (*stop)(void* context) = nullptr;
  void* stop_context = nullptr;

  // kInvalidArgument with the field's name.
  Status Validate() const noexcept {
    if (!(max_error_px > 0.0) || !std::isfinite(max_error_px))
      return Fail(Errc::kInvalidArgument, "max_error_px");
    if (!(confidence > 0.0 && confidence < 1.0)) return Fail(Errc::kInvalidArgument, "confidence");
    if (min_iterations < 0) return Fail(Errc::kInvalidArgument, "min_iterations", min_iterations);
    if (max_iterations < 1) return Fail(Errc::kInvalidArgument, "max_iterations", max_iterations);
    if (max_evaluations < 1) return Fail(Errc::kInvalidArgument, "max_evaluations");
    if (max_refinements < 0)
      return Fail(Errc::kInvalidArgument, "max_refinements", max_refinements);
    return {};
  }
};

enum class RansacEnd : std::uint8_t {
  kConfidence,     // a better sample is unlikely
  kMaxIterations,  // the bounds of the options
  kMaxEvaluations,
  kStopped,  // by the caller's hook
};

struct RansacReport {
  RansacEnd end = RansacEnd::kConfidence;
  int iterations = 0;            // samples
  int models = 0;                // hypotheses from samples
  int refinements = 0;           // local optimisations tried
  std::int64_t evaluations = 0;  // of one observation against one model
  int num_inliers = 0;
  double inlier_ratio = 0.0;
  double score = 0.0;  // sum over observations of min(error^2, max_error^2) or its marginal
};

// What an estimator supplies. Size() observations, numbered from 0. Solve() appends the models of a
// sample. SquaredError() may be NaN or infinite for an impossible observation: an outlier. Refine()
// improves a model on the given observations or returns false and leaves it. An optional kErrorDof
// (1 or 2, default 2) is the number of normal components of an error: kMagsac's.
template <class P>
concept RansacProblem = requires(P& problem, const P& constant, const typename P::Model& model,
                                 typename P::Model* mutable_model, typename P::Models* models,
                                 std::span<const int, P::kSampleSize> sample,
                                 std::span<const int> inliers, int i) {
  { constant.Size() } -> std::convertible_to<int>;
  {problem.Solve(sample, models)};
  { constant.SquaredError(model, i) } -> std::convertible_to<double>;
  { problem.Refine(inliers, mutable_model) } -> std::convertible_to<bool>;
};

// Memory for problems of up to `capacity` observations; the constructor alone allocates.
class RansacWorkspace {
 public:
  explicit RansacWorkspace(std::uint32_t capacity)
      : inliers(capacity), mask(capacity), permutation(capacity) {}
  int capacity() const { return static_cast<int>(inliers.capacity()); }
  std::size_t bytes() const { return inliers.bytes() + mask.bytes() + permutation.bytes(); }

  FixedVector<int> inliers;        // of the returned model, ascending
  FixedVector<std::uint8_t> mask;  // 1 for an inlier of the returned model
  FixedVector<int> permutation;    // sampling without replacement
};

namespace internal {

// Samples needed so that one of them holds inliers only.
inline int RequiredIterations(int num_inliers, int size, int sample_size, double confidence,
                              int max_iterations) {
  double all_inliers = 1.0;
  for (int i = 0; i < sample_size; ++i)
    all_inliers *= std::max(0.0, static_cast<double>(num_inliers - i) / (size - i));
  if (all_inliers >= 1.0) return 1;
  if (all_inliers < 1e-12) return max_iterations;
  const double needed = std::ceil(std::log(1.0 - confidence) / std::log1p(-all_inliers));
  return needed < max_iterations ? static_cast<int>(needed) : max_iterations;
}

template <class P>
constexpr int ErrorDof() {
  if constexpr (requires { P::kErrorDof; }) return P::kErrorDof;
  return 2;
}

// The truncated score, given up (returned as it is then) once it exceeds `bound`.
template <RansacProblem P>
double Score(const P& problem, const typename P::Model& model, const RansacOptions& options,
             double bound, RansacReport* report) {
  const double max_squared_error = options.max_error_px * options.max_error_px;
  double score = 0.0;
  const int size = problem.Size();
  int i = 0;
  if (options.scoring == RansacScoring::kMsac) {
    for (; i < size && score < bound; ++i) {
      const double squared_error = problem.SquaredError(model, i);
      score += squared_error < max_squared_error ? squared_error : max_squared_error;
    }
  } else {
    const auto& loss = MagsacLoss<ErrorDof<P>()>::Get();
    for (; i < size && score < bound; ++i) {
      const double squared_error = problem.SquaredError(model, i);
      score += squared_error < max_squared_error
                   ? max_squared_error * loss(squared_error / max_squared_error)
                   : max_squared_error;
    }
  }
  report->evaluations += i;
  return score;
}

template <RansacProblem P>
void CollectInliers(const P& problem, const typename P::Model& model, double max_squared_error,
                    FixedVector<int>* inliers) {
  inliers->clear();
  for (int i = 0; i < problem.Size(); ++i) {
    if (problem.SquaredError(model, i) < max_squared_error) inliers->TryPushBack(i);
  }
}

// Refines on the inliers as long as that improves the score.
template <RansacProblem P>
void OptimiseLocally(P& problem, const RansacOptions& options, RansacWorkspace* workspace,
                     typename P::Model* model, double* score, RansacReport* report) {
  const double max_squared_error = options.max_error_px * options.max_error_px;
  for (int round = 0; round < options.max_refinements; ++round) {
    CollectInliers(problem, *model, max_squared_error, &workspace->inliers);
    if (static_cast<int>(workspace->inliers.size()) < P::kSampleSize) return;
    typename P::Model refined = *model;
    ++report->refinements;
    if (!problem.Refine(workspace->inliers.span(), &refined)) return;
    const double refined_score = Score(problem, refined, options, *score, report);
    if (!(refined_score < *score)) return;
    const bool is_small = refined_score > *score * (1.0 - 1e-3);
    *model = refined;
    *score = refined_score;
    if (is_small) return;
  }
}

// Draws a sample without replacement: from all observations, or from PROSAC's pool, whose first
// observations are then all that the permutation has ever moved.
template <std::size_t kSize>
void DrawSample(FixedVector<int>* permutation, const ProsacGrowth* growth, Rng* rng,
                std::array<int, kSize>* sample) {
  int pool = growth != nullptr ? growth->pool() : static_cast<int>(permutation->size());
  int count = static_cast<int>(kSize);
  if (growth != nullptr && growth->must_hold_last()) {
    (*sample)[--count] = --pool;
  }
  for (int i = 0; i < count; ++i) {  // the first places of a random permutation
    const int other = i + static_cast<int>(rng->Index(static_cast<std::uint32_t>(pool - i)));
    std::swap((*permutation)[i], (*permutation)[other]);
    (*sample)[i] = (*permutation)[i];
  }
}

// The same as RequiredIterations over the best n observations, for the n that needs the fewest and
// whose inliers are more than a wrong model would find by chance (5 % of them, three sigmas).
//   [Chum & Matas 2005, CVPR, sec. 2.2]
inline int RequiredSortedIterations(std::span<const int> inliers, int size, int sample_size,
                                    double confidence, int max_iterations) {
  constexpr double kChance = 0.05;
  int required = max_iterations;
  for (int count = sample_size + 1; count <= static_cast<int>(inliers.size()); ++count) {
    const bool is_last = count == static_cast<int>(inliers.size());
    const int n = is_last ? size : inliers[count];  // up to the next inlier
    if (n < std::min(size, 20)) continue;
    const double by_chance = sample_size + kChance * n + 3.0 * std::sqrt(kChance * n);
    if (!is_last && count < by_chance) continue;
    required =
        std::min(required, RequiredIterations(count, n, sample_size, confidence, max_iterations));
  }
  return required;
}

}  // namespace internal

// The best model; its inliers and mask are left in the workspace.
//   kInvalidArgument    an option is outside its domain
//   kOutOfCapacity      more observations than the workspace holds; `detail` is the capacity
//   kNotEnoughData      fewer observations than a sample
//   kDegenerate         no sample had a model ("samples")
//   kNotEnoughInliers   no model has kSampleSize inliers
template <RansacProblem P>
Expected<RansacReport> Ransac(P& problem, const RansacOptions& options, RansacWorkspace* workspace,
                              typename P::Model* best_model) noexcept {
  if (const Status status = options.Validate(); !status) return tl::unexpected(status.error());
  const int size = problem.Size();
  if (size > workspace->capacity())
    return Fail(Errc::kOutOfCapacity, "observations", workspace->capacity());
  if (size < P::kSampleSize) return Fail(Errc::kNotEnoughData, "observations", size);

  const double max_squared_error = options.max_error_px * options.max_error_px;
  RansacReport report;
  Rng rng(options.seed);
  workspace->permutation.TryResize(static_cast<std::size_t>(size));
  for (int i = 0; i < size; ++i) workspace->permutation[i] = i;

  typename P::Model model{};
  double best_score = std::numeric_limits<double>::infinity();
  int required = options.max_iterations;
  typename P::Models models;
  internal::ProsacGrowth growth(size, P::kSampleSize, options.max_iterations);
  std::array<int, P::kSampleSize> sample;
  while (true) {
    if (report.iterations >= options.max_iterations) report.end = RansacEnd::kMaxIterations;
    if (report.iterations >= options.max_iterations ||
        (report.iterations >= options.min_iterations && report.iterations >= required)) {
      break;
    }
    ++report.iterations;
    if (options.sorted_by_quality) growth.Next();
    internal::DrawSample(&workspace->permutation, options.sorted_by_quality ? &growth : nullptr,
                         &rng, &sample);
    models.clear();
    problem.Solve(std::span<const int, P::kSampleSize>(sample), &models);
    bool improved = false;
    for (const typename P::Model& candidate : models) {
      ++report.models;
      const double score = internal::Score(problem, candidate, options, best_score, &report);
      if (!(score < best_score)) continue;
      model = candidate;
      best_score = score;
      improved = true;
    }
    if (improved) {
      internal::OptimiseLocally(problem, options, workspace, &model, &best_score, &report);
      internal::CollectInliers(problem, model, max_squared_error, &workspace->inliers);
      required =
          options.sorted_by_quality
              ? internal::RequiredSortedIterations(workspace->inliers.span(), size, P::kSampleSize,
                                                   options.confidence, options.max_iterations)
              : internal::RequiredIterations(static_cast<int>(workspace->inliers.size()), size,
                                             P::kSampleSize, options.confidence,
                                             options.max_iterations);
    }
    if (report.evaluations >= options.max_evaluations) {
      report.end = RansacEnd::kMaxEvaluations;
      break;
    }
    if (options.stop != nullptr && options.stop(options.stop_context)) {
      report.end = RansacEnd::kStopped;
      break;
    }
  }

  if (report.models == 0) return Fail(Errc::kDegenerate, "samples");
  internal::CollectInliers(problem, model, max_squared_error, &workspace->inliers);
  report.num_inliers = static_cast<int>(workspace->inliers.size());
  report.inlier_ratio = static_cast<double>(report.num_inliers) / size;
  report.score = best_score;
  if (report.num_inliers < P::kSampleSize)
    return Fail(Errc::kNotEnoughInliers, "inliers", report.num_inliers);
  workspace->mask.clear();
  workspace->mask.TryResize(static_cast<std::size_t>(size));
  for (const int i : workspace->inliers) workspace->mask[i] = 1;
  *best_model = model;
  return report;
}

// Whether k inliers among n observations are more than chance. An a-contrario test: with a
// probability p that an observation fits a wrong model by chance, the expected number of models as
// good as this among all samples of m is
//   (number of models per sample) (n - m) C(n, k) C(k, m) p^(k - m),
// and the answer is yes when that is below 1e-3.   [Moisan & Stival 2004, IJCV 57(3), eq. (6)]
inline bool IsMeaningful(int num_inliers, int num_observations, int sample_size,
                         double chance_probability, double models_per_sample = 1.0) noexcept {
  const int n = num_observations, k = num_inliers, m = sample_size;
  if (k <= m || k > n) return false;
  const auto log_choose = [](int a, int b) {
    double sum = 0.0;
    for (int i = 1; i <= std::min(b, a - b); ++i)
      sum += std::log(static_cast<double>(a - std::min(b, a - b) + i) / i);
    return sum;
  };
  const double p = std::clamp(chance_probability, 1e-12, 1.0);
  const double log_expected = std::log(models_per_sample * std::max(1, n - m)) + log_choose(n, k) +
                              log_choose(k, m) + (k - m) * std::log(p);
  return log_expected < std::log(1e-3);
}

}  // namespace rsfm
