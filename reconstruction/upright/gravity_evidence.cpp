#include "reconstruction/upright/gravity_evidence.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <Eigen/Dense>
#include <glm/geometric.hpp>

namespace segsim::reconstruction {
namespace {

using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr std::size_t kMostElements = 20'000, kMostCameras = 1000;
constexpr int kDirections = 2000;    ///< Some 4.5 degrees apart.
constexpr double kVoteGate = 0.2;    ///< Sine at which a vote counts nothing.
constexpr double kShareGate = 0.14;  ///< Sine of 8 degrees.
/// Neighbouring elements share points: so many of them are one independent measurement.
constexpr double kDependent = 27.0;

Vector3d eigen(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

struct CameraAxes {
  Vector3d right, up;
};

/// What surfaces and cameras say, as vectors.
struct Evidence {
  std::vector<Vector3d> normals, positions_m;
  std::vector<CameraAxes> cameras;
};

Evidence evidence_of(std::span<const SurfaceElement> elements,
                     std::span<const core::CameraPose> cameras) {
  Evidence evidence;
  const std::size_t step = elements.size() / kMostElements + 1;
  for (std::size_t i = 0; i < elements.size(); i += step) {
    evidence.normals.push_back(eigen(elements[i].normal));
    evidence.positions_m.push_back(eigen(elements[i].position_m));
  }
  const std::size_t camera_step = cameras.size() / kMostCameras + 1;
  for (std::size_t i = 0; i < cameras.size(); i += camera_step) {
    const glm::dquat& R = cameras[i].rotation();
    evidence.cameras.push_back(
        {eigen(R * glm::dvec3(1.0, 0.0, 0.0)), eigen(R * glm::dvec3(0.0, -1.0, 0.0))});
  }
  return evidence;
}

/// How well `up` suits the cameras, 0 to 1: no roll, and any pitch that is not steep.
double camera_support(const std::vector<CameraAxes>& cameras, const Vector3d& up) {
  constexpr double kRoll = 0.2, kEnoughPitch = 0.5;
  double sum = 0.0;
  for (const CameraAxes& camera : cameras) {
    const double roll = camera.right.dot(up) / kRoll;
    sum +=
        std::exp(-0.5 * roll * roll) * std::clamp(camera.up.dot(up) / kEnoughPitch, 0.0, 1.0);
  }
  return sum / static_cast<double>(cameras.size());
}

/// Share of the elements that are level or upright with regard to `up`, near ones in full.
double surface_support(const std::vector<Vector3d>& normals, const Vector3d& up) {
  double sum = 0.0;
  for (const Vector3d& n : normals) {
    const double along = std::abs(n.dot(up));
    if (along < kVoteGate) {
      sum += 1.0 - along / kVoteGate;
    } else if (along > 0.97) {
      sum += std::max(0.0, 1.0 - std::sqrt(std::max(0.0, 1.0 - along * along)) / kVoteGate);
    }
  }
  return sum / static_cast<double>(normals.size());
}

/// Directions spread evenly over the sphere (a Fibonacci spiral).
std::vector<Vector3d> directions() {
  const double golden = std::numbers::pi * (3.0 - std::sqrt(5.0));
  std::vector<Vector3d> result;
  for (int i = 0; i < kDirections; ++i) {
    const double z = 1.0 - (2.0 * i + 1.0) / kDirections, r = std::sqrt(1.0 - z * z);
    result.emplace_back(r * std::cos(golden * i), r * std::sin(golden * i), z);
  }
  return result;
}

struct Candidate {
  Vector3d up = Vector3d::UnitZ();
  double score = 0.0;
  double lead = 0.0;
};

Candidate vote(const Evidence& evidence) {
  const std::vector<Vector3d> all = directions();
  std::vector<double> scores;
  for (const Vector3d& up : all) {
    const double cameras = camera_support(evidence.cameras, up);
    scores.push_back(cameras < 0.02 ? 0.0 : cameras * surface_support(evidence.normals, up));
  }
  const auto best = std::max_element(scores.begin(), scores.end());
  Candidate found{all[static_cast<std::size_t>(best - scores.begin())], *best, 0.0};
  double second = 1e-9;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].dot(found.up) < std::cos(30.0 * kDegree)) second = std::max(second, scores[i]);
  }
  found.lead = found.score / second;
  return found;
}

/// Tukey's weight of a residual: 1 at 0, nothing from the gate on.
double tukey(double residual, double gate) {
  const double ratio = residual / gate;
  return ratio >= 1.0 ? 0.0 : (1.0 - ratio * ratio) * (1.0 - ratio * ratio);
}

/// Two directions perpendicular to `up`.
Eigen::Matrix<double, 3, 2> tangents(const Vector3d& up) {
  Eigen::Matrix<double, 3, 2> basis;
  const Vector3d other = std::abs(up.x()) < 0.7 ? Vector3d::UnitX() : Vector3d::UnitY();
  basis.col(0) = up.cross(other).normalized();
  basis.col(1) = up.cross(basis.col(0));
  return basis;
}

/// A direction and what is known of its tilt: the inverse covariance along tangents(up).
struct Estimate {
  Vector3d up;
  Matrix2d information = Matrix2d::Zero();
};

/// Least squares over the normals: the sine to `up` of those of level surfaces, the cosine of
/// those of walls. Outliers lose their weight as the gate narrows.
Estimate fit_normals(const std::vector<Vector3d>& normals, const Vector3d& start) {
  Estimate found{start};
  for (const double gate : {0.26, 0.20, 0.15, 0.12, 0.10, 0.10, 0.10}) {
    const auto basis = tangents(found.up);
    Matrix2d squares = Matrix2d::Zero();
    Eigen::Vector2d gradient = Eigen::Vector2d::Zero();
    double weight = 0.0, error = 0.0;
    for (const Vector3d& n : normals) {
      const double along = n.dot(found.up);
      const Eigen::Vector2d across = basis.transpose() * n;
      if (std::abs(along) < gate) {  // A wall: n . (up + basis d) = 0.
        const double w = tukey(std::abs(along), gate);
        squares += w * across * across.transpose();
        gradient -= w * along * across;
        error += w * along * along, weight += w;
      } else if (across.norm() < gate) {  // Level: basis d = across, with the sign of n.
        const double w = tukey(across.norm(), gate);
        squares += w * Matrix2d::Identity();
        gradient += w * (along > 0.0 ? across : Eigen::Vector2d(-across));
        error += 0.5 * w * across.squaredNorm(), weight += w;
      }
    }
    const double strength = squares.norm();
    if (!(strength > 0.0) || !(squares.determinant() > 1e-6 * strength * strength)) {
      found.information.setZero();  // One wall, or nothing: any turn about it is as good.
      return found;
    }
    const double noise = std::max(error / weight, 1e-6);
    found.information = squares / (noise * kDependent);
    const Vector3d next = found.up + basis * squares.ldlt().solve(gradient);
    found.up = next.normalized();
  }
  return found;
}

/// The strongest heights of level elements, 0.15 m apart or more.
std::vector<double> level_heights(const std::vector<double>& heights_m) {
  constexpr double kBin_m = 0.04, kApart_m = 0.15;
  constexpr std::size_t kMost = 4, kBins = 5000;
  if (heights_m.empty()) return {};
  const double lowest = *std::min_element(heights_m.begin(), heights_m.end());
  std::vector<double> bins(kBins + 2, 0.0);
  for (const double h : heights_m) {
    const double bin = std::min((h - lowest) / kBin_m, static_cast<double>(kBins));
    bins[static_cast<std::size_t>(bin)] += 1.0;
  }
  std::vector<double> found;
  while (found.size() < kMost) {
    const auto best = std::max_element(bins.begin(), bins.end());
    if (*best < 10.0) break;
    const double height = lowest + (static_cast<double>(best - bins.begin()) + 0.5) * kBin_m;
    found.push_back(height);
    for (std::size_t i = 0; i < bins.size(); ++i) {
      const double here = lowest + (static_cast<double>(i) + 0.5) * kBin_m;
      if (std::abs(here - height) < kApart_m) bins[i] = 0.0;
    }
  }
  return found;
}

/// Level planes know their tilt better than their normals do: metres wide and centimetres
/// rough. The direction across which the points of the largest ones spread least, and the
/// information of that; nothing if no plane is wide enough.
std::optional<Estimate> fit_planes(const Evidence& evidence, const Vector3d& up,
                                   double band_m) {
  std::vector<double> heights_m;
  std::vector<Vector3d> level_m;
  for (std::size_t i = 0; i < evidence.normals.size(); ++i) {
    if (std::abs(evidence.normals[i].dot(up)) < 0.97) continue;
    level_m.push_back(evidence.positions_m[i]);
    heights_m.push_back(up.dot(level_m.back()));
  }
  Matrix3d scatter = Matrix3d::Zero();
  double count = 0.0;
  for (const double height : level_heights(heights_m)) {
    Vector3d mean = Vector3d::Zero();
    std::vector<Vector3d> plane;
    for (std::size_t i = 0; i < level_m.size(); ++i) {
      if (std::abs(heights_m[i] - height) < band_m) plane.push_back(level_m[i]);
    }
    if (plane.size() < 30) continue;
    for (const Vector3d& p : plane) mean += p / static_cast<double>(plane.size());
    for (const Vector3d& p : plane) scatter += (p - mean) * (p - mean).transpose();
    count += static_cast<double>(plane.size());
  }
  if (count == 0.0) return std::nullopt;
  const Eigen::SelfAdjointEigenSolver<Matrix3d> axes(scatter);
  constexpr double kNarrowest_m = 0.4;  // Standard deviation along the shorter side.
  if (axes.eigenvalues()[1] < count * kNarrowest_m * kNarrowest_m) return std::nullopt;
  Estimate found{axes.eigenvectors().col(0)};
  if (found.up.dot(up) < 0.0) found.up = -found.up;
  const auto basis = tangents(found.up);
  const double noise_m2 = std::max(axes.eigenvalues()[0] / count, 1e-6);
  found.information = basis.transpose() * scatter * basis / (noise_m2 * kDependent);
  return found;
}

double spread_of(const Matrix2d& information) {
  const Eigen::SelfAdjointEigenSolver<Matrix2d> axes(information);
  const double least = axes.eigenvalues()[0];
  return least > 0.0 ? 1.0 / std::sqrt(least) : std::numeric_limits<double>::infinity();
}

Estimate refine(const Evidence& evidence, const Vector3d& start) {
  Estimate found = fit_normals(evidence.normals, start);
  for (const double band_m : {0.10, 0.07, 0.05}) {
    const auto planes = fit_planes(evidence, found.up, band_m);
    if (!planes || planes->up.dot(found.up) < std::cos(3.0 * kDegree)) break;
    found = *planes;
  }
  return found;
}

}  // namespace

bool GravityEvidence::sure() const {
  return elements >= 150 && level_share + wall_share >= 0.4 && upright_share >= 0.5 &&
         lead >= 1.3 && spread_rad <= 0.7 * kDegree;
}

std::optional<GravityEvidence> find_gravity(std::span<const SurfaceElement> elements,
                                            std::span<const core::CameraPose> cameras) {
  if (elements.empty() || cameras.empty()) return std::nullopt;
  const Evidence evidence = evidence_of(elements, cameras);
  const Candidate candidate = vote(evidence);
  if (!(candidate.score > 0.0)) return std::nullopt;
  const Estimate estimate = refine(evidence, candidate.up);
  if (estimate.information.isZero()) return std::nullopt;
  GravityEvidence found;
  const Vector3d& up = estimate.up;
  found.up = {up.x(), up.y(), up.z()};
  found.spread_rad = spread_of(estimate.information);
  found.elements = evidence.normals.size();
  found.lead = candidate.lead;
  for (const Vector3d& n : evidence.normals) {
    const double along = std::abs(n.dot(up));
    if (along < kShareGate) found.wall_share += 1.0;
    if (along > std::sqrt(1.0 - kShareGate * kShareGate)) found.level_share += 1.0;
  }
  found.wall_share /= static_cast<double>(found.elements);
  found.level_share /= static_cast<double>(found.elements);
  const double upright = static_cast<double>(
      std::count_if(evidence.cameras.begin(), evidence.cameras.end(), [&](const auto& camera) {
        return std::abs(camera.right.dot(up)) < std::sin(20.0 * kDegree) &&
               camera.up.dot(up) > 0.0;
      }));
  found.upright_share = upright / static_cast<double>(evidence.cameras.size());
  return found;
}

std::optional<glm::dvec3> up_of_cameras(std::span<const core::CameraPose> cameras) {
  constexpr std::size_t kFewest = 8;
  constexpr double kMostlyUpright = 0.5, kManyHeadings = 0.1;
  if (cameras.size() < kFewest) return std::nullopt;
  const Evidence evidence = evidence_of({}, cameras);
  Vector3d best = Vector3d::UnitZ();
  double most = 0.0;
  for (const Vector3d& up : directions()) {
    const double support = camera_support(evidence.cameras, up);
    if (support > most) most = support, best = up;
  }
  if (most < kMostlyUpright) return std::nullopt;
  Matrix3d squares = Matrix3d::Zero();
  for (const CameraAxes& camera : evidence.cameras) {
    if (std::abs(camera.right.dot(best)) > std::sin(20.0 * kDegree)) continue;
    squares += camera.right * camera.right.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3d> axes(squares);
  if (axes.eigenvalues()[1] > kManyHeadings * axes.eigenvalues()[2]) {
    const Vector3d normal = axes.eigenvectors().col(0);
    best = normal.dot(best) < 0.0 ? Vector3d(-normal) : normal;
  }
  return glm::dvec3(best.x(), best.y(), best.z());
}

}  // namespace segsim::reconstruction
