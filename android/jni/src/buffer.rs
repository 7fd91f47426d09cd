//! Memory of direct `ByteBuffer`s as slices: the only place where an address from Java becomes a reference.
#![allow(unsafe_code)]
use crate::Failure;
use jni::Env;
use jni::objects::JByteBuffer;

/// Address and capacity of a direct buffer; null, heap and negative-sized buffers are [`Failure::Argument`].
fn place(env: &Env<'_>, buffer: &JByteBuffer<'_>, what: &'static str) -> Result<(*mut u8, usize), Failure> {
    if buffer.is_null() {
        return Err(Failure::Null(what));
    }
    let direct = "must be a direct ByteBuffer (ByteBuffer.allocateDirect, or a camera's)";
    let address =
        env.get_direct_buffer_address(buffer).map_err(|_| Failure::Argument(format!("{what} {direct}")))?;
    let capacity =
        env.get_direct_buffer_capacity(buffer).map_err(|_| Failure::Argument(format!("{what} {direct}")))?;
    if capacity > isize::MAX as usize {
        return Err(Failure::Argument(format!("{what} is larger than memory")));
    }
    Ok((address, capacity))
}

/// The whole buffer (from address to capacity), for reading during one native call.
///
/// Java code must not write to it meanwhile: the library's documentation says so of every frame.
pub(crate) fn read<'b>(
    env: &Env<'_>,
    buffer: &'b JByteBuffer<'_>,
    what: &'static str,
) -> Result<&'b [u8], Failure> {
    let (address, capacity) = place(env, buffer, what)?;
    // SAFETY: the JVM gave address and capacity of one live direct buffer; the local reference that `'b` borrows keeps
    // it alive; the capacity fits isize (checked). That nobody writes to it is the caller's promise (doc above).
    Ok(unsafe { std::slice::from_raw_parts(address, capacity) })
}

/// The whole buffer, for writing during one native call; `inputs` must not overlap it.
pub(crate) fn write<'b>(
    env: &Env<'_>,
    buffer: &'b mut JByteBuffer<'_>,
    inputs: &[&[u8]],
    what: &'static str,
) -> Result<&'b mut [u8], Failure> {
    let (address, capacity) = place(env, buffer, what)?;
    let start = address as usize;
    let end = start.saturating_add(capacity);
    for input in inputs {
        let range = input.as_ptr_range();
        if (range.start as usize) < end && start < range.end as usize {
            return Err(Failure::Argument(format!("{what} overlaps the pixels given")));
        }
    }
    // SAFETY: as in `read`; no other slice of this call overlaps it (checked), and the Java side hands an output
    // buffer to one native call at a time (`MaterialMaps` is filled under the engine's lock).
    Ok(unsafe { std::slice::from_raw_parts_mut(address, capacity) })
}
