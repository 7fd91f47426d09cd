//! Numbers as texts: statuses, classes, stages, levels. Static, never freed.
#![expect(unsafe_code, reason = "unmangled names")]

use crate::status::flashmat_status;
use core::ffi::{CStr, c_char};

fn status(number: i32) -> Option<flashmat_status> {
    flashmat_status::ALL.into_iter().find(|&status| status as i32 == number)
}

/// The name at `number`, counted from `first`; empty for numbers outside.
fn name(names: &[&'static CStr], number: u32, first: u32) -> *const c_char {
    let index = number.checked_sub(first).and_then(|index| usize::try_from(index).ok());
    index.and_then(|index| names.get(index)).map_or(c"".as_ptr(), |name| name.as_ptr())
}

pub(crate) const CLASSES: [&CStr; 8] =
    [c"fabric", c"ground", c"leather", c"metal", c"stone-diff", c"stone-spec", c"polymer", c"wood"];
pub(crate) const STAGES: [&CStr; 11] = [
    c"frame",
    c"global",
    c"flash",
    c"highlight",
    c"albedo",
    c"texture",
    c"normal",
    c"search",
    c"roughness",
    c"level",
    c"relight",
];
pub(crate) const LEVELS: [&CStr; 6] = [c"scalar", c"avx2", c"avx512vnni", c"neon", c"dotprod", c"i8mm"];

/// A status' constant as text, such as "FLASHMAT_STATUS_BUSY". Static; empty for numbers that are no status.
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_status_name(number: i32) -> *const c_char {
    status(number).map_or(c"".as_ptr(), |status| status.name().as_ptr())
}

/// What a status means, in English; flashmat_last_error knows more of a certain call. Static; empty for numbers that
/// are no status. Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_status_text(number: i32) -> *const c_char {
    status(number).map_or(c"".as_ptr(), |status| status.text().as_ptr())
}

/// A class' name: "fabric", "ground", "leather", "metal", "stone-diff", "stone-spec", "polymer", "wood". Static; empty
/// for FLASHMAT_CLASS_AUTO and numbers that are no class. Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_class_name(material_class: u32) -> *const c_char {
    name(&CLASSES, material_class, 1)
}

/// A stage's name, such as "albedo". Static; empty for numbers that are no stage. Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_stage_name(stage: u32) -> *const c_char {
    name(&STAGES, stage, 0)
}

/// A level's name, such as "neon". Static; empty for FLASHMAT_LEVEL_AUTO and numbers that are no level. Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_level_name(level: u32) -> *const c_char {
    name(&LEVELS, level, 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use flashmat_core::Stage;
    use flashmat_core::base::simd::Level;
    use flashmat_core::net::Class;

    #[test]
    fn names_are_the_cores() {
        let texts = |names: &[&'static CStr]| {
            names.iter().map(|name| name.to_str().expect("UTF-8")).collect::<std::vec::Vec<_>>()
        };
        assert_eq!(texts(&CLASSES), Class::ALL.map(Class::name));
        assert_eq!(texts(&STAGES), Stage::ALL.map(Stage::name));
        assert_eq!(texts(&LEVELS), Level::ALL.map(Level::name));
        for (index, class) in (1..).zip(Class::ALL) {
            assert_eq!(crate::input::class_code(class), index);
        }
        for (index, stage) in (0..).zip(Stage::ALL) {
            assert_eq!(crate::input::stage_code(stage), index);
        }
        for (index, level) in (1..).zip(Level::ALL) {
            assert_eq!(crate::input::level_code(level), index);
        }
        for (number, status) in (0..).zip(flashmat_status::ALL) {
            assert_eq!(status as i32, number, "{status:?}");
        }
    }
}
