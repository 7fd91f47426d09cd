//! One block of a scan, followed code by code (ISO/IEC 10918-1, annexes F and G).
use super::bits::{Bits, Broken, Huffman};

/// What a scan holds of each block.
pub(super) struct Pass {
    /// First and last coefficient, 0..=63.
    pub(super) start: u32,
    pub(super) end: u32,
    /// Not 0: bits that refine what earlier scans sent.
    pub(super) high: u32,
}

/// F.2.2: a DC difference, then runs of zeros and values.
#[inline(always)]
pub(super) fn sequential(bits: &mut Bits<'_>, dc: &Huffman, ac: &Huffman) -> Result<(), Broken> {
    let size = bits.symbol(dc)?;
    if size > 16 {
        return Err(Broken::Code);
    }
    bits.skip(size)?;
    let mut k = 1;
    while k < 64 {
        let code = bits.symbol(ac)?;
        let (zeros, size) = (code >> 4, code & 15);
        if size == 0 {
            if zeros != 15 {
                break;
            }
            k += 16;
        } else {
            k += zeros + 1;
            if k > 64 {
                return Err(Broken::Code);
            }
            bits.skip(size)?;
        }
    }
    Ok(())
}

/// G.1.2: one pass over a block. `nonzero` has a bit for each coefficient that is not zero; `run` counts blocks without
/// further values.
pub(super) fn progressive(
    bits: &mut Bits<'_>,
    pass: &Pass,
    dc: Option<&Huffman>,
    ac: Option<&Huffman>,
    nonzero: &mut u64,
    run: &mut u32,
) -> Result<(), Broken> {
    if pass.start == 0 {
        if pass.high != 0 {
            return bits.skip(1);
        }
        let size = bits.symbol(dc.ok_or(Broken::Code)?)?;
        return if size > 16 { Err(Broken::Code) } else { bits.skip(size) };
    }
    let ac = ac.ok_or(Broken::Code)?;
    let mut k = pass.start;
    while *run == 0 && k <= pass.end {
        let code = bits.symbol(ac)?;
        let (mut zeros, size) = (code >> 4, code & 15);
        if size == 0 && zeros < 15 {
            *run = (1 << zeros) + bits.take(zeros)?;
            break;
        }
        if pass.high == 0 {
            k += zeros;
            if size > 0 {
                if k > pass.end {
                    return Err(Broken::Code);
                }
                bits.skip(size)?;
                *nonzero |= 1 << k;
            }
            k += 1;
            continue;
        }
        if size > 1 {
            return Err(Broken::Code);
        }
        bits.skip(size)?;
        // Known values on the way are refined by a bit each; zeros are counted.
        while k <= pass.end {
            if *nonzero >> k & 1 == 1 {
                bits.skip(1)?;
            } else if zeros == 0 {
                break;
            } else {
                zeros -= 1;
            }
            k += 1;
        }
        if size == 1 {
            if k > pass.end {
                return Err(Broken::Code);
            }
            *nonzero |= 1 << k;
        }
        k += 1;
    }
    if *run > 0 {
        if pass.high != 0 && k <= pass.end {
            let rest = *nonzero >> k & (u64::MAX >> (63 - (pass.end - k)));
            for _ in 0..rest.count_ones() {
                bits.skip(1)?;
            }
        }
        *run -= 1;
    }
    Ok(())
}
