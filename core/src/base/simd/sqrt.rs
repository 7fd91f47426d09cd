//! Square roots, one after the other: the same instruction at three widths, rounded correctly.
#![allow(unsafe_code)]
use crate::base::math::sqrtf;
use core::arch::x86_64::{
    _mm_loadu_ps, _mm_sqrt_ps, _mm_storeu_ps, _mm256_loadu_ps, _mm256_sqrt_ps, _mm256_storeu_ps,
    _mm512_loadu_ps, _mm512_sqrt_ps, _mm512_storeu_ps,
};

/// Four at a time, with what every x86-64 CPU has.
pub(super) fn sse2(values: &mut [f32]) {
    let (whole, rest) = values.as_chunks_mut::<4>();
    for four in whole {
        // SAFETY: every x86-64 CPU has SSE; four values are read and written.
        unsafe { _mm_storeu_ps(four.as_mut_ptr(), _mm_sqrt_ps(_mm_loadu_ps(four.as_ptr()))) };
    }
    rest.iter_mut().for_each(|value| *value = sqrtf(*value));
}

/// Eight at a time.
#[target_feature(enable = "avx2")]
pub(super) fn avx2(values: &mut [f32]) {
    let (whole, rest) = values.as_chunks_mut::<8>();
    for eight in whole {
        // SAFETY: eight values are read and written.
        unsafe { _mm256_storeu_ps(eight.as_mut_ptr(), _mm256_sqrt_ps(_mm256_loadu_ps(eight.as_ptr()))) };
    }
    rest.iter_mut().for_each(|value| *value = sqrtf(*value));
}

/// Sixteen at a time.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
pub(super) fn avx512(values: &mut [f32]) {
    let (whole, rest) = values.as_chunks_mut::<16>();
    for sixteen in whole {
        // SAFETY: sixteen values are read and written.
        unsafe { _mm512_storeu_ps(sixteen.as_mut_ptr(), _mm512_sqrt_ps(_mm512_loadu_ps(sixteen.as_ptr()))) };
    }
    rest.iter_mut().for_each(|value| *value = sqrtf(*value));
}
