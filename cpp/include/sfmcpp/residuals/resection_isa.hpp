// The kernels of one instruction set; only resection.cpp chooses among them (core/isa.hpp).
#pragma once

#include "sfmcpp/residuals/resection.hpp"

namespace sfmcpp::residuals::baseline {
ResectionKernels resection_kernels_for(CameraModelId model);
}
namespace sfmcpp::residuals::avx2 {
ResectionKernels resection_kernels_for(CameraModelId model);
}
namespace sfmcpp::residuals::avx512 {
ResectionKernels resection_kernels_for(CameraModelId model);
}
