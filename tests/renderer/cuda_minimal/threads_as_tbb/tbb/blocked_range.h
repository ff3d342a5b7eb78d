#pragma once
#include "threads_as_tbb/threads_as_tbb.h"
