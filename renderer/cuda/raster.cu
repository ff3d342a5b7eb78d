#include "renderer/cuda/raster.cuh"

namespace segsim::renderer::cuda {

void launch_raster(const FrameView& frame, const SceneView& scene, const PanopticView& field,
                   const FeatureView& features, bool redo, cudaStream_t stream) {
  const RasterJob job{frame,
                      frame.record,
                      scene.place,
                      scene.label,
                      static_cast<std::size_t>(scene.clusters) * kClusterSurfels,
                      field,
                      features,
                      redo};
  const bool selects = (frame.labels && (field.head != nullptr || scene.label != nullptr)) ||
                       (frame.features && features.semantic != nullptr);
  if (!selects) {
    launch_raster_of<0>(job, stream);
  } else if (frame.top_k <= kFewKeys && !frame.first_hits) {
    launch_raster_of<kFewKeys>(job, stream);
  } else {
    launch_raster_many(job, stream);
  }
}

}  // namespace segsim::renderer::cuda
