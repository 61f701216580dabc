#pragma once
// Functions that must be compiled with their callers' instruction set; private to the core.

#if defined(__GNUC__)
#define VSR2_INLINE __attribute__((always_inline)) inline
#else
#define VSR2_INLINE inline
#endif
