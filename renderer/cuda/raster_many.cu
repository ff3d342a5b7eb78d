#include "renderer/cuda/raster.cuh"

namespace segsim::renderer::cuda {

void launch_raster_many(const RasterJob& job, cudaStream_t stream) {
  launch_raster_of<kManyKeys>(job, stream);
}

}  // namespace segsim::renderer::cuda
