//! The segments of a JPEG file, and whether every block of its picture has data (ISO/IEC 10918-1).
//!
//! Baseline, extended sequential and progressive Huffman scans are followed code by code, as the decoder will, but no
//! pixel is computed. Data ends early when a marker comes before the last block; it is out of step when bytes are left
//! over, or when a code exists in no table. Restart markers confine what is lost to their interval.
use super::bits::{Bits, Broken, Huffman};
use super::block::{Pass, progressive, sequential};
use std::ops::Range;

/// Left-over bytes before a marker that are no sign of damage: encoders pad.
const PADDING: usize = 2;

/// What is known of a file.
pub(super) struct File {
    /// Width and height in pixels.
    pub(super) size: Option<(u32, u32)>,
    /// The kind of JPEG, when it is one that is not decoded.
    pub(super) unsupported: Option<&'static str>,
    /// APP1 segments that hold EXIF, and APP2 segments that hold parts of an ICC profile, behind their names.
    pub(super) exif: Vec<Range<usize>>,
    pub(super) icc: Vec<Range<usize>>,
    pub(super) verdict: Verdict,
    /// Where the picture's data ends.
    pub(super) end: usize,
}

/// Whether the picture is whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    /// Every block has data.
    Whole,
    /// It cannot be told, as when a table is missing: the decoder decides.
    Unknown,
    /// A share of the blocks, ]0,1], has no data or data that makes no sense; perhaps another JPEG begins inside.
    Missing { share: f64, another: bool },
    /// Every block has data, but so many bytes belong to none: they are out of step.
    Surplus { bytes: usize },
    /// Progressive: whole, but for passes that never came.
    Coarse,
}

struct Component {
    id: u8,
    h: usize,
    v: usize,
    /// Blocks that a scan of this component alone has.
    columns: usize,
    rows: usize,
    /// Blocks of a row, padded for scans of several components.
    stride: usize,
    /// Progressive: which coefficients of each block are not zero so far.
    nonzero: Vec<u64>,
    /// Lowest bit sent so far of each coefficient; [`UNSENT`]: none.
    low: [u8; 64],
}

const UNSENT: u8 = u8::MAX;

/// More scans than this are left to the decoder, which refuses them.
const MOST_SCANS: usize = 100;
/// Pictures of more pixels are refused for their size; nothing of them is followed.
const MOST_PIXELS: u64 = super::super::MAX_PIXELS;

struct Frame {
    progressive: bool,
    /// It is small enough to be decoded.
    followed: bool,
    columns: usize,
    rows: usize,
    components: Vec<Component>,
}

/// One component's part in a scan.
struct Part {
    component: usize,
    dc: usize,
    ac: usize,
}

struct Scan {
    parts: Vec<Part>,
    pass: Pass,
}

/// How a scan went.
#[derive(Clone, Copy, Default)]
struct Outcome {
    /// Share of its blocks without data.
    missing: f64,
    surplus: usize,
    another: bool,
    /// Where its data ends.
    end: usize,
}

#[derive(Default)]
struct Tables {
    dc: [Option<Huffman>; 4],
    ac: [Option<Huffman>; 4],
    restart: usize,
}

/// Reads the file's segments and follows its scans.
pub(super) fn read(bytes: &[u8]) -> File {
    let mut file = File {
        size: None,
        unsupported: None,
        exif: Vec::new(),
        icc: Vec::new(),
        verdict: Verdict::Whole,
        end: bytes.len(),
    };
    let mut tables = Tables::default();
    let mut frame: Option<Frame> = None;
    let mut total = Outcome::default();
    let mut scans = 0_usize;
    let mut at = 2;
    while let Some((marker, body)) = segment(bytes, at) {
        let content = bytes.get(body.clone()).unwrap_or(&[]);
        match marker {
            // The end; or another file, whose picture is not this one.
            0xd9 | 0xd8 => break,
            0xc4 if define_tables(content, &mut tables).is_none() => file.verdict = Verdict::Unknown,
            0xdd => tables.restart = content.first_chunk().map_or(0, |b| usize::from(u16::from_be_bytes(*b))),
            0xc0..=0xc2 if frame.is_none() => match read_frame(marker, content) {
                Ok((size, read)) => {
                    file.size = Some(size);
                    frame = Some(read);
                }
                Err(kind) => file.unsupported = kind.or(file.unsupported),
            },
            0xc3 | 0xc7 => file.unsupported = Some("lossless coding"),
            0xc5 | 0xc6 | 0xde => file.unsupported = Some("hierarchical coding"),
            0xc9..=0xcb | 0xcd..=0xcf => file.unsupported = Some("arithmetic coding"),
            0xe1 if content.starts_with(b"Exif\0") => file.exif.push(body.clone()),
            0xe2 if content.starts_with(b"ICC_PROFILE\0") => file.icc.push(body.start + 12..body.end),
            0xda => {
                let Some(frame) = &mut frame else { break };
                let scan = read_scan(content, frame);
                if scan.as_ref().is_some_and(|scan| is_apart(frame, scan)) {
                    file.unsupported = Some("subsampled colours in scans of their own");
                }
                let outcome = match scan {
                    Some(scan)
                        if file.verdict != Verdict::Unknown
                            && file.unsupported.is_none()
                            && scans < MOST_SCANS =>
                    {
                        follow(bytes, body.end, frame, &scan, &tables)
                    }
                    _ => None,
                };
                let Some(outcome) = outcome else {
                    file.verdict = Verdict::Unknown;
                    break;
                };
                scans += 1;
                total.missing = total.missing.max(outcome.missing);
                total.surplus = total.surplus.max(outcome.surplus);
                total.another |= outcome.another;
                file.end = outcome.end;
                at = next_marker(bytes, outcome.end);
                continue;
            }
            _ => {}
        }
        at = body.end;
    }
    if file.verdict != Verdict::Unknown
        && let Some(frame) = &frame
    {
        file.verdict = verdict(frame, total, scans);
    }
    file
}

fn verdict(frame: &Frame, total: Outcome, scans: usize) -> Verdict {
    let sent = |k: usize| frame.components.iter().all(|c| c.low.get(k) != Some(&UNSENT));
    if scans == 0 || !sent(0) {
        return Verdict::Missing { share: 1.0, another: total.another };
    }
    if total.missing > 0.0 {
        return Verdict::Missing { share: total.missing, another: total.another };
    }
    if total.surplus > 0 {
        return Verdict::Surplus { bytes: total.surplus };
    }
    let fine = frame.components.iter().all(|c| c.low.iter().all(|&low| low == 0));
    if frame.progressive && !fine { Verdict::Coarse } else { Verdict::Whole }
}

/// The marker at or after `at`, and where its segment's content lies; a segment that reaches beyond the file has none.
fn segment(bytes: &[u8], at: usize) -> Option<(u8, Range<usize>)> {
    let at = next_marker(bytes, at);
    let marker = *bytes.get(at + 1)?;
    if matches!(marker, 0x01 | 0xd0..=0xd9) {
        return Some((marker, at + 2..at + 2));
    }
    let length = usize::from(u16::from_be_bytes(*bytes.get(at + 2..)?.first_chunk()?));
    let end = at + 2 + length.max(2);
    (end <= bytes.len()).then_some((marker, at + 4..end))
}

/// Where the next marker's 0xff stands (the last one of several), or the end of the file. Restart markers count.
fn next_marker(bytes: &[u8], mut at: usize) -> usize {
    while let Some(rest) = bytes.get(at..) {
        let Some(found) = rest.iter().position(|&b| b == 0xff) else { break };
        at += found;
        match bytes.get(at + 1) {
            Some(0) => at += 2,
            Some(0xff) => at += 1,
            Some(_) => return at,
            None => break,
        }
    }
    bytes.len()
}

fn define_tables(mut content: &[u8], tables: &mut Tables) -> Option<()> {
    while let Some((&id, rest)) = content.split_first() {
        let (counts, rest) = rest.split_first_chunk::<16>()?;
        let symbols: usize = counts.iter().map(|&n| usize::from(n)).sum();
        let (symbols, rest) = rest.split_at_checked(symbols)?;
        let class = if id >> 4 == 0 { &mut tables.dc } else { &mut tables.ac };
        *class.get_mut(usize::from(id & 15))? = Some(Huffman::new(counts, symbols)?);
        content = rest;
    }
    Some(())
}

/// The frame, or what about it is not supported; `None`: it is broken.
fn read_frame(marker: u8, content: &[u8]) -> Result<((u32, u32), Frame), Option<&'static str>> {
    let (&[precision, h1, h0, w1, w0, count], mut rest) = content.split_first_chunk::<6>().ok_or(None)?;
    let (width, height) = (u16::from_be_bytes([w1, w0]), u16::from_be_bytes([h1, h0]));
    if precision != 8 {
        return Err(Some("12 bits per sample"));
    }
    if height == 0 {
        return Err(Some("its height at the end"));
    }
    if width == 0 || !matches!(count, 1 | 3 | 4) {
        return Err(Some("an unusual number of channels"));
    }
    let mut components = Vec::new();
    for _ in 0..count {
        let (&[id, sampling, _], more) = rest.split_first_chunk::<3>().ok_or(None)?;
        rest = more;
        let (h, v) = (usize::from(sampling >> 4), usize::from(sampling & 15));
        if !(1..=4).contains(&h) || !(1..=4).contains(&v) {
            return Err(None);
        }
        components.push((id, h, v));
    }
    let most = |of: fn(&(u8, usize, usize)) -> usize| components.iter().map(of).max().unwrap_or(1);
    let (most_h, most_v) = (most(|c| c.1), most(|c| c.2));
    // The decoder takes the first component for the finest, and the others for whole parts of it.
    let first = components.first().map(|c| (c.1, c.2));
    if first != Some((most_h, most_v)) || components.iter().any(|c| most_h % c.1 != 0 || most_v % c.2 != 0) {
        return Err(Some("unusual chroma sampling"));
    }
    let (wide, high) = (usize::from(width), usize::from(height));
    let followed = u64::from(width) * u64::from(height) <= MOST_PIXELS;
    let (columns, rows) = (wide.div_ceil(8 * most_h), high.div_ceil(8 * most_v));
    let progressive = marker == 0xc2 && followed;
    let components = components
        .into_iter()
        .map(|(id, h, v)| Component {
            id,
            h,
            v,
            columns: (wide * h).div_ceil(8 * most_h),
            rows: (high * v).div_ceil(8 * most_v),
            stride: columns * h,
            nonzero: if progressive { vec![0; columns * h * rows * v] } else { Vec::new() },
            low: [UNSENT; 64],
        })
        .collect();
    Ok(((width.into(), height.into()), Frame { progressive, followed, columns, rows, components }))
}

fn read_scan(content: &[u8], frame: &mut Frame) -> Option<Scan> {
    let (&count, mut rest) = content.split_first().filter(|_| frame.followed)?;
    let mut parts = Vec::new();
    for _ in 0..count {
        let (&[id, tables], more) = rest.split_first_chunk::<2>()?;
        rest = more;
        let component = frame.components.iter().position(|c| c.id == id)?;
        parts.push(Part { component, dc: usize::from(tables >> 4), ac: usize::from(tables & 15) });
    }
    let (&[start, end, approximation], _) = rest.split_first_chunk::<3>()?;
    let (start, end) = if frame.progressive { (start, end) } else { (0, 63) };
    if end > 63 || start > end || parts.is_empty() || (frame.progressive && (start == 0) != (end == 0)) {
        return None;
    }
    let (high, low) = if frame.progressive { (approximation >> 4, approximation & 15) } else { (0, 0) };
    for part in &parts {
        let sent =
            frame.components.get_mut(part.component)?.low.get_mut(usize::from(start)..=usize::from(end))?;
        sent.fill(low);
    }
    let pass = Pass { start: start.into(), end: end.into(), high: high.into() };
    Some(Scan { parts, pass })
}

/// Whether the scan is one that the decoder garbles: sequential, without all components, of a subsampled picture.
fn is_apart(frame: &Frame, scan: &Scan) -> bool {
    let subsampled = frame.components.iter().any(|c| (c.h, c.v) != (1, 1));
    !frame.progressive && scan.parts.len() < frame.components.len() && subsampled
}

/// Follows the scan whose data starts at `at`; `None` when a table is missing.
fn follow(bytes: &[u8], at: usize, frame: &mut Frame, scan: &Scan, tables: &Tables) -> Option<Outcome> {
    let alone = match scan.parts.as_slice() {
        [part] => Some(frame.components.get(part.component)?),
        _ => None,
    };
    let (columns, rows) = alone.map_or((frame.columns, frame.rows), |c| (c.columns, c.rows));
    let alone = alone.is_some();
    let units = columns * rows;
    let interval = if tables.restart == 0 { units } else { tables.restart };
    let mut outcome = Outcome { end: at, ..Outcome::default() };
    let (mut start, mut missing, mut restart) = (0, 0, 0_u8);
    while start < units {
        let stop = units.min(start + interval);
        let mut bits = Bits::new(bytes, outcome.end);
        let mut run = 0;
        let mut broken = None;
        for unit in start..stop {
            if let Err(why) = one_unit(&mut bits, frame, scan, tables, alone, (unit, columns), &mut run)? {
                missing += stop - unit;
                broken = Some(why);
                break;
            }
        }
        outcome.end = bits.end();
        let marker = next_marker(bytes, outcome.end);
        let surplus = bytes.get(outcome.end..marker).unwrap_or(&[]);
        let kind = bytes.get(marker + 1).copied();
        outcome.another |= kind == Some(0xd8) && (broken.is_some() || stop < units);
        let last = stop == units;
        // Behind the last block of a file without an end marker lies whatever the camera appends.
        let appended = last && !matches!(kind, Some(0xc4 | 0xd0..=0xd7 | 0xd9..=0xdd));
        let padding = surplus.iter().all(|&b| b == 0) || surplus.iter().all(|&b| b == 0xff);
        if broken.is_none() && surplus.len() > PADDING && !padding && !appended {
            if last {
                outcome.surplus = surplus.len();
            } else {
                // Out of step before a restart marker: this interval cannot be trusted.
                missing += stop - start;
            }
        }
        start = stop;
        if start < units {
            let Some(number @ 0xd0..=0xd7) = kind else {
                missing += units - start;
                break;
            };
            // Intervals whose markers are gone are gone themselves.
            let lost = usize::from((number - 0xd0).wrapping_sub(restart) & 7) * interval;
            missing += lost.min(units - start);
            start = (start + lost).min(units);
            restart = (number - 0xd0 + 1) & 7;
            outcome.end = marker + 2;
        } else if broken.is_some() && last {
            outcome.end = marker;
        }
    }
    outcome.missing = missing as f64 / units.max(1) as f64;
    let data = at..outcome.end;
    if let Some(lost) = zeroed(bytes, data.clone()).filter(|_| !zeros_are_flat(frame, scan, tables)) {
        outcome.missing = outcome.missing.max(lost.len() as f64 / data.len().max(1) as f64);
    }
    Some(outcome)
}

/// A run of zero bytes as long as half a disk sector, and what follows it up to the next marker: now and then such a
/// sector holds as many codes as the one that it has replaced.
fn zeroed(bytes: &[u8], data: Range<usize>) -> Option<Range<usize>> {
    const RUN: usize = 256;
    let scan = bytes.get(data.clone())?;
    let is_zero = |part: &[u8]| part.iter().all(|&b| b == 0);
    // Every such run covers one of these pieces.
    let piece = scan.chunks_exact(RUN / 2).position(is_zero)? * (RUN / 2);
    let before = scan.get(..piece)?.iter().rev().take_while(|&&b| b == 0).count();
    let start = piece - before;
    let is_run = scan.get(start..start + RUN).is_some_and(is_zero);
    is_run.then(|| data.start + start..next_marker(bytes, data.start + start).min(data.end))
}

/// Whether zero bits code blocks without detail, of which a picture may have many in a row.
fn zeros_are_flat(frame: &Frame, scan: &Scan, tables: &Tables) -> bool {
    let zero = |table: Option<&Option<Huffman>>| {
        table.and_then(Option::as_ref).and_then(|table| Bits::new(&[0; 8], 0).symbol(table).ok())
    };
    scan.parts.iter().all(|part| {
        let (dc, ac) = (zero(tables.dc.get(part.dc)), zero(tables.ac.get(part.ac)));
        match (frame.progressive, scan.pass.start, scan.pass.high) {
            (false, ..) => (dc, ac) == (Some(0), Some(0)),
            (true, _, 1..) => true,
            (true, 0, 0) => dc == Some(0),
            // The end of one block, or of many.
            (true, ..) => ac.is_some_and(|symbol| symbol & 15 == 0 && symbol < 0xf0),
        }
    })
}

/// Follows one unit of a scan: a block of its only component, or the blocks of all. `None` when a table is missing.
#[inline(always)]
fn one_unit(
    bits: &mut Bits<'_>,
    frame: &mut Frame,
    scan: &Scan,
    tables: &Tables,
    alone: bool,
    (unit, columns): (usize, usize),
    run: &mut u32,
) -> Option<Result<(), Broken>> {
    let (row, column) = (unit / columns, unit % columns);
    for part in &scan.parts {
        let component = frame.components.get_mut(part.component)?;
        let (h, v) = if alone { (1, 1) } else { (component.h, component.v) };
        let table = |of: &'_ [Option<Huffman>; 4], id: usize| of.get(id).is_some_and(Option::is_some);
        let needs_dc = scan.pass.start == 0 && scan.pass.high == 0;
        if (needs_dc && !table(&tables.dc, part.dc)) || (scan.pass.end > 0 && !table(&tables.ac, part.ac)) {
            return None;
        }
        let (dc, ac) = (tables.dc.get(part.dc)?.as_ref(), tables.ac.get(part.ac)?.as_ref());
        for y in 0..v {
            for x in 0..h {
                let block = (row * v + y) * component.stride + column * h + x;
                let done = match (frame.progressive, dc, ac) {
                    (false, Some(dc), Some(ac)) => sequential(bits, dc, ac),
                    (false, ..) => return None,
                    (true, ..) => {
                        progressive(bits, &scan.pass, dc, ac, component.nonzero.get_mut(block)?, run)
                    }
                };
                if let Err(broken) = done {
                    return Some(Err(broken));
                }
            }
        }
    }
    Some(Ok(()))
}
