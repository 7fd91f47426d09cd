//! CPU support as a value: which instruction set the kernels may use.
use crate::Error;

/// An instruction set that kernels are written for. All levels give the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Level {
    /// Plain loops, any CPU: the definition of every kernel.
    Scalar,
    /// x86-64 with AVX2.
    Avx2,
    /// x86-64 with AVX-512 F, BW, VL and VNNI.
    Avx512Vnni,
    /// AArch64 with Advanced SIMD (every AArch64 CPU).
    Neon,
    /// AArch64 with the dot-product extension.
    DotProd,
    /// AArch64 with the int8 matrix-multiply extension (and the dot products).
    I8mm,
}

impl Level {
    /// Every level, slowest first within its architecture.
    pub const ALL: [Self; 6] =
        [Self::Scalar, Self::Avx2, Self::Avx512Vnni, Self::Neon, Self::DotProd, Self::I8mm];

    /// The name that the command line and reports use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Scalar => "scalar",
            Self::Avx2 => "avx2",
            Self::Avx512Vnni => "avx512vnni",
            Self::Neon => "neon",
            Self::DotProd => "dotprod",
            Self::I8mm => "i8mm",
        }
    }

    /// The level of that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|level| level.name() == name)
    }

    /// The fastest level that this CPU supports and that has kernels; asks the CPU.
    #[cfg(feature = "std")]
    #[must_use]
    pub fn detect() -> Self {
        Self::best(Self::is_supported)
    }

    /// The fastest level that the compiler was told every CPU of the target has: for builds without `std`.
    #[must_use]
    pub fn baseline() -> Self {
        Self::best(Self::is_baseline)
    }

    fn best(has: fn(Self) -> bool) -> Self {
        Self::ALL.into_iter().filter(|&level| has(level)).max().unwrap_or(Self::Scalar)
    }

    /// The lower of this level and `wanted`: a caller may go down from what was detected, never up.
    ///
    /// # Errors
    /// [`Error::LevelUnsupported`] when `wanted` is above this level or of another architecture.
    pub fn lowered_to(self, wanted: Self) -> Result<Self, Error> {
        if wanted.is_built()
            && (wanted == Self::Scalar || (wanted <= self && wanted.is_x86() == self.is_x86()))
        {
            Ok(wanted)
        } else {
            Err(Error::LevelUnsupported { level: wanted })
        }
    }

    const fn is_x86(self) -> bool {
        matches!(self, Self::Avx2 | Self::Avx512Vnni)
    }

    /// Whether this build has kernels of the level: it is one of the target's architecture.
    pub(crate) const fn is_built(self) -> bool {
        match self {
            Self::Scalar => true,
            Self::Avx2 | Self::Avx512Vnni => cfg!(target_arch = "x86_64"),
            Self::Neon | Self::DotProd | Self::I8mm => {
                cfg!(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))
            }
        }
    }

    /// Whether this CPU can run the level: the CPU's answer with `std`, the compiler's without.
    #[must_use]
    pub fn is_supported(self) -> bool {
        if !self.is_built() {
            return false;
        }
        #[cfg(all(feature = "std", target_arch = "x86_64"))]
        match self {
            Self::Avx2 => return std::arch::is_x86_feature_detected!("avx2"),
            Self::Avx512Vnni => {
                return std::arch::is_x86_feature_detected!("avx512f")
                    && std::arch::is_x86_feature_detected!("avx512bw")
                    && std::arch::is_x86_feature_detected!("avx512vl")
                    && std::arch::is_x86_feature_detected!("avx512vnni");
            }
            _ => {}
        }
        #[cfg(all(feature = "std", target_arch = "aarch64"))]
        match self {
            Self::DotProd => return std::arch::is_aarch64_feature_detected!("dotprod"),
            Self::I8mm => {
                return std::arch::is_aarch64_feature_detected!("dotprod")
                    && std::arch::is_aarch64_feature_detected!("i8mm");
            }
            _ => {}
        }
        self.is_baseline()
    }

    /// Whether every CPU that this build runs on has the level.
    const fn is_baseline(self) -> bool {
        match self {
            Self::Scalar => true,
            Self::Avx2 => cfg!(all(target_arch = "x86_64", target_feature = "avx2")),
            Self::Avx512Vnni => cfg!(all(
                target_arch = "x86_64",
                target_feature = "avx512f",
                target_feature = "avx512bw",
                target_feature = "avx512vl",
                target_feature = "avx512vnni"
            )),
            Self::Neon => cfg!(all(target_arch = "aarch64", target_feature = "neon")),
            Self::DotProd => cfg!(all(target_arch = "aarch64", target_feature = "dotprod")),
            Self::I8mm => {
                cfg!(all(target_arch = "aarch64", target_feature = "dotprod", target_feature = "i8mm"))
            }
        }
    }
}

/// Whether this CPU looks bytes up in registers (AVX-512 VBMI), which no level implies: the CPU's answer with `std`, the
/// compiler's without.
#[cfg(target_arch = "x86_64")]
pub(super) fn has_vbmi() -> bool {
    #[cfg(feature = "std")]
    return std::arch::is_x86_feature_detected!("avx512vbmi");
    #[cfg(not(feature = "std"))]
    cfg!(target_feature = "avx512vbmi")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_distinct_and_found_again() {
        for level in Level::ALL {
            assert_eq!(Level::from_name(level.name()), Some(level));
        }
        assert_eq!(Level::from_name("sse9"), None);
    }

    #[test]
    fn lowering_never_raises() {
        for detected in Level::ALL {
            for wanted in Level::ALL {
                match detected.lowered_to(wanted) {
                    Ok(level) => assert!(level == wanted && (wanted == Level::Scalar || wanted <= detected)),
                    Err(error) => assert_eq!(error, Error::LevelUnsupported { level: wanted }),
                }
            }
            assert_eq!(detected.lowered_to(Level::Scalar), Ok(Level::Scalar));
        }
        assert!(Level::Avx2.lowered_to(Level::Avx512Vnni).is_err());
    }

    #[test]
    fn detection_reaches_the_baseline() {
        assert!(Level::baseline() <= Level::detect());
        assert!(Level::detect().is_supported());
    }
}
