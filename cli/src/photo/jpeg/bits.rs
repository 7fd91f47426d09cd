//! Huffman codes of a JPEG scan, followed without computing a pixel.

/// Why the codes cannot be followed further.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Broken {
    /// The data ends, or a marker comes, before the blocks do.
    Short,
    /// A code that no table has, or one that leaves its block.
    Code,
}

/// Bits that [`Huffman::codes`] is indexed by.
const AHEAD: u32 = 9;

/// A Huffman table.
pub(super) struct Huffman {
    /// Length << 8 | symbol for each start of `AHEAD` bits; 0: a longer code.
    codes: [u16; 1 << AHEAD],
    /// Per length 1..=16: one past the largest code, aligned to 16 bits; below it are codes of that length or shorter.
    limits: [u32; 17],
    /// Per length: index of the first symbol less the first code.
    offsets: [i32; 17],
    symbols: Vec<u8>,
}

impl Huffman {
    /// From a DHT segment's counts of codes per length and the symbols.
    pub(super) fn new(counts: &[u8; 16], symbols: &[u8]) -> Option<Self> {
        let mut table =
            Self { codes: [0; 1 << AHEAD], limits: [0; 17], offsets: [0; 17], symbols: symbols.to_vec() };
        let (mut code, mut index) = (0_u32, 0_usize);
        for (length, &count) in (1_u32..).zip(counts) {
            *table.offsets.get_mut(length as usize)? = index as i32 - code as i32;
            for _ in 0..count {
                let symbol = *symbols.get(index)?;
                if length <= AHEAD {
                    let first = (code << (AHEAD - length)) as usize;
                    let codes = table.codes.get_mut(first..first + (1 << (AHEAD - length)))?;
                    codes.fill((length as u16) << 8 | u16::from(symbol));
                }
                code += 1;
                index += 1;
            }
            if code > 1 << length {
                return None;
            }
            *table.limits.get_mut(length as usize)? = code << (16 - length);
            code <<= 1;
        }
        Some(table)
    }
}

/// The bits of one entropy-coded segment: up to the next marker.
pub(super) struct Bits<'a> {
    data: &'a [u8],
    /// Of the next byte to take.
    at: usize,
    /// The next `have` bits, at the top.
    ahead: u64,
    have: u32,
    /// A marker or the end of the data has been reached.
    ended: bool,
}

impl<'a> Bits<'a> {
    pub(super) fn new(data: &'a [u8], at: usize) -> Self {
        Self { data, at, ahead: 0, have: 0, ended: false }
    }

    #[inline(always)]
    fn fill(&mut self) {
        // Four bytes at once unless there is a 0xff among them.
        if self.have <= 32
            && let Some(bytes) = self.data.get(self.at..).and_then(<[u8]>::first_chunk::<4>)
        {
            let word = u32::from_be_bytes(*bytes);
            if !has_ff(word) {
                self.ahead |= u64::from(word) << (32 - self.have);
                self.have += 32;
                self.at += 4;
                return;
            }
        }
        self.fill_slowly();
    }

    #[cold]
    fn fill_slowly(&mut self) {
        while self.have <= 56 && !self.ended {
            let (byte, length) = match (self.data.get(self.at), self.data.get(self.at + 1)) {
                // A stuffed zero.
                (Some(0xff), Some(0)) => (0xff, 2),
                (Some(0xff), _) | (None, _) => {
                    self.ended = true;
                    return;
                }
                (Some(&byte), _) => (byte, 1),
            };
            self.at += length;
            self.ahead |= u64::from(byte) << (56 - self.have);
            self.have += 8;
        }
    }

    #[inline(always)]
    fn need(&mut self, bits: u32) -> Result<(), Broken> {
        if self.have < bits {
            self.fill();
            if self.have < bits {
                return Err(Broken::Short);
            }
        }
        Ok(())
    }

    /// Passes over up to 32 bits.
    #[inline(always)]
    pub(super) fn skip(&mut self, bits: u32) -> Result<(), Broken> {
        self.need(bits)?;
        self.ahead <<= bits;
        self.have -= bits;
        Ok(())
    }

    /// The next `bits` bits, at most 16.
    pub(super) fn take(&mut self, bits: u32) -> Result<u32, Broken> {
        if bits == 0 {
            return Ok(0);
        }
        self.need(bits)?;
        let value = (self.ahead >> (64 - bits)) as u32;
        self.skip(bits)?;
        Ok(value)
    }

    /// The symbol of the next code.
    #[inline(always)]
    pub(super) fn symbol(&mut self, table: &Huffman) -> Result<u32, Broken> {
        if self.have < 32 {
            self.fill();
        }
        let code = table.codes.get((self.ahead >> (64 - AHEAD)) as usize).copied().unwrap_or(0);
        if code == 0 {
            return self.long_symbol(table);
        }
        let length = u32::from(code >> 8);
        if self.have < length {
            return Err(Broken::Short);
        }
        self.ahead <<= length;
        self.have -= length;
        Ok(u32::from(code & 0xff))
    }

    #[cold]
    fn long_symbol(&mut self, table: &Huffman) -> Result<u32, Broken> {
        let next = (self.ahead >> 48) as u32;
        let Some(length) =
            (AHEAD + 1..=16).find(|&l| next < table.limits.get(l as usize).copied().unwrap_or(0))
        else {
            // Ones at the end of the data are padding, not a code.
            return Err(if self.have < 16 { Broken::Short } else { Broken::Code });
        };
        let index = (next >> (16 - length)) as i32 + table.offsets.get(length as usize).copied().unwrap_or(0);
        let symbol = usize::try_from(index).ok().and_then(|i| table.symbols.get(i)).copied();
        self.skip(length)?;
        symbol.map(u32::from).ok_or(Broken::Code)
    }

    /// Where the byte after the last bit taken lies; unread bits of a byte are padding.
    pub(super) fn end(&self) -> usize {
        // Bytes taken ahead are given back; a stuffed one has two.
        let mut at = self.at;
        for _ in 0..self.have / 8 {
            at -= if at >= 2 && self.data.get(at - 2..at) == Some(&[0xff, 0]) { 2 } else { 1 };
        }
        at
    }
}

/// Whether one of the four bytes is 0xff.
#[inline(always)]
const fn has_ff(word: u32) -> bool {
    // The classic test for a zero byte, of the complement.
    let word = !word;
    word.wrapping_sub(0x0101_0101) & !word & 0x8080_8080 != 0
}
