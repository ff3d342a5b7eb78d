// The paper's Table 1 as it is printed (its LaTeX source), in percent.
#include "experiments/panoptic/panoptic_table.h"

namespace segsim::experiments::panoptic {
namespace {

constexpr const char* kScanNet = "ScanNet";
constexpr const char* kScanNetPlusPlus = "ScanNet++";

constexpr PaperRow kRows[] = {
    {"Panoptic Lifting", kScanNet, "panoptic-lifting", 57.86, 61.96, 85.31, 67.91, 78.59,
     45.88, 59.93},
    {"Panoptic Lifting", kScanNetPlusPlus, "panoptic-lifting", 71.14, 77.48, 88.14, 81.34,
     89.67, 56.17, 68.51},
    {"Contrastive Lift", kScanNet, "contrastive-lift", 37.35, 41.91, 57.60, 64.77, 75.80,
     13.21, 23.26},
    {"Contrastive Lift", kScanNetPlusPlus, "contrastive-lift", 47.58, 57.23, 65.81, 81.09,
     89.30, 27.39, 36.51},
    {"PVLFF", kScanNet, "pvlff", 30.11, 51.71, 44.43, 55.41, 63.96, 45.75, 48.41},
    {"PVLFF", kScanNetPlusPlus, "pvlff", 52.24, 66.86, 65.56, 62.53, 70.31, 67.95, 75.47},
    {"Gaussian Grouping", kScanNet, "gaussian-grouping", 43.75, 50.63, 72.68, 58.05, 68.68,
     52.70, 58.10},
    {"Gaussian Grouping", kScanNetPlusPlus, "gaussian-grouping", 33.10, 40.60, 67.27, 59.53,
     68.13, 29.83, 36.83},
    {"OpenGaussian", kScanNet, "open-gaussian", 48.73, 51.48, 88.10, 54.05, 68.43, 44.43,
     49.60},
    {"OpenGaussian", kScanNetPlusPlus, "open-gaussian", 51.03, 56.93, 85.73, 61.80, 73.97,
     50.00, 51.02},
    {"PanopticRecon", kScanNet, "panoptic-recon", 63.70, 64.81, 81.17, 68.62, 80.87, 66.58,
     77.84},
    {"PanopticRecon", kScanNetPlusPlus, "panoptic-recon", 68.29, 77.01, 85.05, 77.75, 87.08,
     51.34, 62.79},
    {"Fast-SegSim", kScanNet, "query", 74.12, 74.12, 100.0, 74.93, 83.07, 72.89, 79.14},
    {"Fast-SegSim", kScanNetPlusPlus, "query", 77.09, 82.36, 93.60, 81.77, 89.01, 74.23,
     77.91},
};

}  // namespace

std::span<const PaperRow> paper_table1() { return kRows; }

}  // namespace segsim::experiments::panoptic
