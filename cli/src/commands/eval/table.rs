//! The tables of errors: text, Markdown, CSV.
use crate::metrics::{MapErrors, mean};
use flashmat_core::net::Class;
use std::fmt::Write as _;

/// Errors on one photo, or means over several.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Errors {
    pub(super) maps: MapErrors,
    /// RMSE of re-renderings under the unseen lights, gamma 2.2.
    pub(super) relit: f64,
    /// Right classes: 0 or 1, or a share.
    pub(super) class: f64,
    /// Of the re-render against the photo; none where nothing was captured.
    pub(super) residual: Option<f64>,
}

/// One photo's result.
#[derive(Clone, Debug)]
pub(super) struct Row {
    pub(super) class: Class,
    pub(super) name: String,
    pub(super) errors: Errors,
    pub(super) found: Class,
}

/// All photos by one method.
pub(super) struct Method {
    pub(super) name: String,
    pub(super) rows: Vec<Row>,
}

impl Method {
    /// Means over the photos of `class`, or all of them, and how many there are.
    pub(super) fn means(&self, class: Option<Class>) -> (usize, Errors) {
        let rows = || self.rows.iter().filter(move |row| class.is_none_or(|class| class == row.class));
        let of = |f: fn(&Errors) -> f64| mean(rows().map(|row| f(&row.errors)));
        let residuals = rows().filter_map(|row| row.errors.residual);
        let errors = Errors {
            maps: MapErrors {
                albedo: of(|e| e.maps.albedo),
                albedo_scaled: of(|e| e.maps.albedo_scaled),
                albedo_normalised: of(|e| e.maps.albedo_normalised),
                normal: of(|e| e.maps.normal),
                roughness: of(|e| e.maps.roughness),
                angle_deg: of(|e| e.maps.angle_deg),
            },
            relit: of(|e| e.relit),
            class: of(|e| e.class),
            residual: residuals.clone().next().map(|_| mean(residuals)),
        };
        (rows().count(), errors)
    }
}

/// Name, heading above it, and digits of each column.
const COLUMNS: [(&str, &str, usize); 11] = [
    ("MSE", "albedo", 4),
    ("MSE", "to scale", 4),
    ("MSE", "normal", 4),
    ("MSE", "rough", 4),
    ("RMSE", "albedo", 3),
    ("RMSE", "rough", 3),
    ("mean", "angle", 1),
    ("class", "right %", 0),
    ("relit", "RMSE", 3),
    ("photo", "resid.", 3),
    ("1e-4", "albedo-N", 1),
];

fn values(e: &Errors) -> [Option<f64>; COLUMNS.len()] {
    let [albedo, normal, roughness] = e.maps.paper();
    [
        Some(albedo),
        Some(4.0 * e.maps.albedo_scaled),
        Some(normal),
        Some(roughness),
        Some(e.maps.albedo.sqrt()),
        Some(e.maps.roughness.sqrt()),
        Some(e.maps.angle_deg),
        Some(100.0 * e.class),
        Some(e.relit),
        e.residual,
        Some(1e4 * e.maps.albedo_normalised),
    ]
}

fn cells(e: &Errors) -> Vec<String> {
    let cell = |(value, (_, _, digits)): (Option<f64>, &(&str, &str, usize))| {
        value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
    };
    values(e).into_iter().zip(&COLUMNS).map(cell).collect()
}

/// What the columns mean.
pub(super) const LEGEND: &str = "\
MSE: the paper's convention, albedo and roughness on [-1,1], unit normals; to scale: albedo after the best single
factor for each photo, since no photo tells its exposure; RMSE: linear albedo, roughness in [0,1]; angle: degrees; relit: lights
not seen, gamma 2.2; resid.: re-render against the photo; albedo-N: MSE in [0,1] of albedos whose mean pixel norm is 0.5.
constants: albedo 0.22, flat, roughness 0.6; mean colour: the photo's, flat, roughness 0.5; classical: photo less a fitted
highlight over falloff, normals from its gradients, one fitted roughness; all three with the commonest class.";

/// The first method by class, then every method over all photos.
pub(super) fn text(methods: &[Method]) -> String {
    let mut out = String::new();
    let heading = |f: fn(&(&str, &str, usize)) -> String| -> String {
        COLUMNS.iter().map(|column| format!(" {:>8}", f(column))).collect()
    };
    let mut line = |name: &str, n: &str, rest: &str| {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{name:<36} {n:>5}{rest}");
    };
    line("", "", &heading(|c| c.0.to_owned()));
    line("", "n", &heading(|c| c.1.to_owned()));
    let row = |e: &Errors| -> String { cells(e).iter().map(|cell| format!(" {cell:>8}")).collect() };
    for (i, method) in methods.iter().enumerate() {
        if i == 0 {
            for class in Class::ALL {
                let (n, errors) = method.means(Some(class));
                if n > 0 {
                    line(&format!("  {}", class.name()), &n.to_string(), &row(&errors));
                }
            }
        }
        let (n, errors) = method.means(None);
        line(&method.name, &n.to_string(), &row(&errors));
    }
    out + "\n" + LEGEND
}

/// The same for a model's card.
pub(super) fn markdown(methods: &[Method], title: &str) -> String {
    let mut out = format!("{title}\n\n");
    let heads = [
        "albedo",
        "albedo to scale",
        "normal",
        "roughness",
        "albedo RMSE",
        "roughness RMSE",
        "angle",
        "class",
        "relit RMSE",
        "residual",
        "albedo-N, 1e-4",
    ];
    let table = |out: &mut String, first: &str, rows: &[(String, Errors)]| {
        let _ = writeln!(out, "| {first} | {} |", heads.join(" | "));
        let _ = writeln!(out, "|{}", " --- |".repeat(heads.len() + 1));
        for (name, errors) in rows {
            let _ = writeln!(out, "| {name} | {} |", cells(errors).join(" | "));
        }
    };
    let all: Vec<_> = methods.iter().map(|m| (m.name.clone(), m.means(None).1)).collect();
    table(&mut out, "method", &all);
    let Some(method) = methods.first() else { return out };
    let of_class = |class: Class| {
        let (n, errors) = method.means(Some(class));
        (n > 0).then(|| (format!("{} ({n})", class.name()), errors))
    };
    let mut rows: Vec<_> = Class::ALL.into_iter().filter_map(of_class).collect();
    let (n, total) = method.means(None);
    rows.push((format!("total ({n})"), total));
    let _ = writeln!(out, "\nBy type, {}:\n", method.name);
    table(&mut out, "type", &rows);
    let _ = write!(out, "\n{LEGEND}\n");
    out
}

/// One line for each method and photo.
pub(super) fn csv(methods: &[Method]) -> String {
    let mut text = "method,class,name,found,albedo_mse_paper,albedo_scaled_mse_paper,normal_mse_paper,\
                    roughness_mse_paper,albedo_rmse,roughness_rmse,angle_deg,relit_rmse,residual,albedo_n_mse\n"
        .to_owned();
    for (method, row) in methods.iter().flat_map(|m| m.rows.iter().map(move |row| (m, row))) {
        let maps = &row.errors.maps;
        let [albedo, normal, roughness] = maps.paper();
        let residual = row.errors.residual.map_or_else(String::new, |r| format!("{r:.6}"));
        let quoted = |name: &str| format!("\"{}\"", name.replace('"', "\"\""));
        let _ = writeln!(
            text,
            "{},{},{},{},{albedo:.6},{:.6},{normal:.6},{roughness:.6},{:.6},{:.6},{:.4},{:.6},{residual},{:.6}",
            quoted(&method.name),
            row.class.name(),
            quoted(&row.name),
            row.found.name(),
            4.0 * maps.albedo_scaled,
            maps.albedo.sqrt(),
            maps.roughness.sqrt(),
            maps.angle_deg,
            row.errors.relit,
            maps.albedo_normalised,
        );
    }
    text
}

/// Errors at each strength of the environment: the sweep.
pub(super) fn sweep_csv(points: &[(f32, Errors)]) -> String {
    let mut text =
        "environment,albedo_mse_paper,albedo_scaled_mse_paper,normal_mse_paper,roughness_mse_paper,\
                    class_right,relit_rmse\n"
            .to_owned();
    for (strength, e) in points {
        let [albedo, normal, roughness] = e.maps.paper();
        let scaled = 4.0 * e.maps.albedo_scaled;
        let _ = writeln!(
            text,
            "{strength:.2},{albedo:.6},{scaled:.6},{normal:.6},{roughness:.6},{:.4},{:.6}",
            e.class, e.relit
        );
    }
    text
}
