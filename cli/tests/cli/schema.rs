//! JSON Schema, as far as `docs/report.schema.json` uses it: an unknown keyword is an error, so that none is taken for
//! checked that is not.
use serde_json::{Map, Value};
use std::path::Path;

/// The reports' schema.
pub(crate) fn report_schema() -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/report.schema.json");
    serde_json::from_slice(&std::fs::read(path).expect("the schema")).expect("JSON")
}

/// What in `value` is against `schema`, a part of `root`; each complaint names its place.
pub(crate) fn complaints(root: &Value, schema: &Value, value: &Value, at: &str) -> Vec<String> {
    let schema = schema.as_object().expect("a schema is an object");
    let mut found = Vec::new();
    for (keyword, wanted) in schema {
        let good = match keyword.as_str() {
            "$schema" | "$id" | "$defs" | "title" | "description" => true,
            "$ref" => {
                let pointer = wanted.as_str().and_then(|r| r.strip_prefix('#')).expect("a reference inside");
                found.extend(complaints(root, root.pointer(pointer).expect("definition"), value, at));
                true
            }
            "const" => value == wanted,
            "enum" => wanted.as_array().expect("values").contains(value),
            "type" => is_a(wanted.as_str().expect("type"), value),
            "minimum" => number(value) >= number(wanted),
            "maximum" => number(value) <= number(wanted),
            "exclusiveMinimum" => number(value) > number(wanted),
            "exclusiveMaximum" => number(value) < number(wanted),
            "multipleOf" => number(value) % number(wanted) == 0.0,
            "minLength" => text(value).chars().count() >= number(wanted) as usize,
            "pattern" => matches_pattern(text(wanted), text(value)),
            "minItems" => list(value).len() >= number(wanted) as usize,
            "maxItems" => list(value).len() <= number(wanted) as usize,
            "uniqueItems" => list(value).iter().enumerate().all(|(i, v)| !list(value)[..i].contains(v)),
            "items" => {
                let of = |(i, v)| complaints(root, wanted, v, &format!("{at}/{i}"));
                found.extend(list(value).iter().enumerate().flat_map(of));
                true
            }
            "required" => list(wanted).iter().all(|name| value.get(text(name)).is_some()),
            "properties" | "additionalProperties" => {
                found.extend(members(root, schema, keyword, value, at));
                true
            }
            unknown => panic!("the schema's keyword {unknown} is not checked"),
        };
        if !good {
            found.push(format!("{at}: {keyword} {wanted}, but {value}"));
        }
    }
    found
}

fn members(root: &Value, schema: &Map<String, Value>, keyword: &str, value: &Value, at: &str) -> Vec<String> {
    let known = schema["properties"].as_object().expect("properties");
    let mut found = Vec::new();
    for (name, member) in value.as_object().into_iter().flatten() {
        let place = format!("{at}/{name}");
        match (keyword, known.get(name), &schema["additionalProperties"]) {
            ("properties", Some(schema), _) => found.extend(complaints(root, schema, member, &place)),
            ("additionalProperties", None, Value::Bool(false)) => found.push(format!("{place}: unknown")),
            ("additionalProperties", None, schema) => found.extend(complaints(root, schema, member, &place)),
            _ => {}
        }
    }
    found
}

fn is_a(kind: &str, value: &Value) -> bool {
    match kind {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "number" => value.is_number(),
        "integer" => value.as_f64().is_some_and(|v| v.fract() == 0.0),
        unknown => panic!("the schema's type {unknown} is not checked"),
    }
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// The schema's three patterns, without an engine for all others.
fn matches_pattern(pattern: &str, text: &str) -> bool {
    match pattern {
        "^[0-9a-f]{64}$" => text.len() == 64 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f')),
        "^[^/\\\\]+$" => !text.is_empty() && !text.contains(['/', '\\']),
        r"^[0-9]+\.[0-9]+\.[0-9]+" => {
            let digits = |part: &str| part.bytes().take_while(u8::is_ascii_digit).count();
            let parts: Vec<_> = text.splitn(3, '.').collect();
            parts.len() == 3
                && parts[..2].iter().all(|part| digits(part) == part.len() && !part.is_empty())
                && digits(parts[2]) > 0
        }
        unknown => panic!("the schema's pattern {unknown} is not checked"),
    }
}
