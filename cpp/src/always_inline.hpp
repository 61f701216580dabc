#pragma once
// Functions that must be compiled with their callers' instruction set; private to the core.

#if defined(__GNUC__)
#define VSR2_INLINE_LAMBDA __attribute__((always_inline))
#else
#define VSR2_INLINE_LAMBDA
#endif
#define VSR2_INLINE VSR2_INLINE_LAMBDA inline
