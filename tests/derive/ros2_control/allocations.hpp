// Counts what is allocated while `counts` is set, by C and (operator new calls malloc) by C++. For glibc, and
// not beside sanitizers, which have a malloc of their own.
#pragma once
#include <cstddef>

namespace
{
bool counts = false;
long allocations = 0;
}  // namespace

extern "C" {
void * __libc_malloc(std::size_t size);
void * __libc_calloc(std::size_t count, std::size_t size);
void * __libc_realloc(void * place, std::size_t size);
void * __libc_memalign(std::size_t alignment, std::size_t size);

void * malloc(std::size_t size)
{
  allocations += counts;
  return __libc_malloc(size);
}
void * calloc(std::size_t count, std::size_t size)
{
  allocations += counts;
  return __libc_calloc(count, size);
}
void * realloc(void * place, std::size_t size)
{
  allocations += counts;
  return __libc_realloc(place, size);
}
void * aligned_alloc(std::size_t alignment, std::size_t size)
{
  allocations += counts;
  return __libc_memalign(alignment, size);
}
}
