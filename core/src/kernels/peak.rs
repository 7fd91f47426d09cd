//! The multiply-accumulate rate that a level's instructions could reach: its dot products on registers alone, nothing
//! loaded or stored. What benches call 100 %.
#![allow(unsafe_code)]
use crate::base::simd::Level;

/// Runs `rounds` (at least 1) rounds of the level's dot products and gives the number of multiply-accumulates done, for
/// the caller to time; `None` where nothing is written for the level or this CPU lacks it.
#[must_use]
pub fn multiply_accumulates(level: Level, rounds: u32) -> Option<u64> {
    #[cfg(target_arch = "x86_64")]
    if level.is_supported() {
        let rounds = rounds.max(1);
        match level {
            // SAFETY: the CPU has the level.
            Level::Avx2 => return Some(unsafe { avx2(rounds) }),
            // SAFETY: as above.
            Level::Avx512Vnni => return Some(unsafe { avx512vnni(rounds) }),
            _ => {}
        }
    }
    let _ = (level, rounds);
    None
}

/// Eight `vpmaddwd` with their `vpaddd`: 16 products each.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2(rounds: u32) -> u64 {
    // SAFETY: only registers that are named as overwritten change; what they held before does not matter.
    unsafe {
        core::arch::asm!(
            "2:",
            "vpmaddwd ymm8, ymm14, ymm15",
            "vpmaddwd ymm9, ymm14, ymm15",
            "vpmaddwd ymm10, ymm14, ymm15",
            "vpmaddwd ymm11, ymm14, ymm15",
            "vpaddd ymm0, ymm0, ymm8",
            "vpaddd ymm1, ymm1, ymm9",
            "vpaddd ymm2, ymm2, ymm10",
            "vpaddd ymm3, ymm3, ymm11",
            "vpmaddwd ymm8, ymm14, ymm15",
            "vpmaddwd ymm9, ymm14, ymm15",
            "vpmaddwd ymm10, ymm14, ymm15",
            "vpmaddwd ymm11, ymm14, ymm15",
            "vpaddd ymm4, ymm4, ymm8",
            "vpaddd ymm5, ymm5, ymm9",
            "vpaddd ymm6, ymm6, ymm10",
            "vpaddd ymm7, ymm7, ymm11",
            "dec {n:e}",
            "jnz 2b",
            n = inout(reg) rounds => _,
            out("ymm0") _, out("ymm1") _, out("ymm2") _, out("ymm3") _,
            out("ymm4") _, out("ymm5") _, out("ymm6") _, out("ymm7") _,
            out("ymm8") _, out("ymm9") _, out("ymm10") _, out("ymm11") _,
            options(nomem, nostack),
        );
    }
    u64::from(rounds) * 8 * 16
}

/// Twelve `vpdpbusd`, more than latency times width: 64 products each.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vnni")]
fn avx512vnni(rounds: u32) -> u64 {
    // SAFETY: as in `avx2`.
    unsafe {
        core::arch::asm!(
            "2:",
            "vpdpbusd zmm0, zmm14, zmm15",
            "vpdpbusd zmm1, zmm14, zmm15",
            "vpdpbusd zmm2, zmm14, zmm15",
            "vpdpbusd zmm3, zmm14, zmm15",
            "vpdpbusd zmm4, zmm14, zmm15",
            "vpdpbusd zmm5, zmm14, zmm15",
            "vpdpbusd zmm6, zmm14, zmm15",
            "vpdpbusd zmm7, zmm14, zmm15",
            "vpdpbusd zmm8, zmm14, zmm15",
            "vpdpbusd zmm9, zmm14, zmm15",
            "vpdpbusd zmm10, zmm14, zmm15",
            "vpdpbusd zmm11, zmm14, zmm15",
            "dec {n:e}",
            "jnz 2b",
            n = inout(reg) rounds => _,
            out("zmm0") _, out("zmm1") _, out("zmm2") _, out("zmm3") _,
            out("zmm4") _, out("zmm5") _, out("zmm6") _, out("zmm7") _,
            out("zmm8") _, out("zmm9") _, out("zmm10") _, out("zmm11") _,
            options(nomem, nostack),
        );
    }
    u64::from(rounds) * 12 * 64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_counted_where_there_is_a_probe() {
        assert_eq!(multiply_accumulates(Level::Scalar, 7), None);
        for (level, per_round) in [(Level::Avx2, 128), (Level::Avx512Vnni, 768)] {
            let expected = level.is_supported().then_some(1000 * per_round);
            assert_eq!(multiply_accumulates(level, 1000), expected, "{}", level.name());
        }
    }
}
