//! The page's figures: names and kinds of the viewer's report.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

use super::page::{STATS, serve, settle};
use super::tab;
use crate::support::PICTURE_PX;
use crate::support::scene::TestScene;

/// Figures of the viewer's report that a tab does not have: a simulation's, lists of frames, and times of passes.
const NATIVE_ONLY: [&str; 5] = ["loss", "seed", "frames", "drawing", "shadow_bytes"];

/// Name and type of each field of the report that `lodestream-viewer --stats` writes.
fn report() -> BTreeMap<String, String> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../viewer/src/report.rs");
    let file = syn::parse_file(&std::fs::read_to_string(file).unwrap()).unwrap();
    let report = file.items.into_iter().find_map(|item| match item {
        syn::Item::Struct(of) if of.ident == "Report" => Some(of),
        _ => None,
    });
    let text = |kind: &syn::Type| {
        let syn::Type::Path(path) = kind else { return "&str".to_owned() };
        path.path.segments.last().unwrap().ident.to_string()
    };
    let fields = report.expect("the report").fields;
    fields.iter().map(|field| (field.ident.as_ref().unwrap().to_string(), text(&field.ty))).collect()
}

#[test]
fn the_figures_of_a_tab_have_the_names_and_kinds_of_the_viewers_report() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    settle(&mut tab, &server.page_url());
    // The settled picture is presented a frame later.
    let stats = tab
        .wait("the settled picture is presented", STATS, |stats| stats["settled_presented_ms"].is_number());
    let report = report();
    assert!(report.len() > 20, "{report:?}");
    for (name, kind) in &report {
        let figure = stats.get(name);
        if NATIVE_ONLY.contains(&name.as_str()) {
            assert_eq!(figure, None, "{name} means something else in the viewer's report");
            continue;
        }
        let figure = figure.unwrap_or_else(|| panic!("{name} is missing: {stats}"));
        let fits = match kind.as_str() {
            "String" | "&str" => figure.is_string(),
            "bool" => figure.is_boolean(),
            "u64" | "f64" => figure.is_number(),
            "Option" => figure.is_number() || figure.is_null(),
            "Vec" => figure.is_array(),
            "BTreeMap" => figure.is_object(),
            other => panic!("{name} is of a kind that this test does not know: {other}"),
        };
        assert!(fits, "{name}: {figure} is no {kind}");
    }
    // Times of the report count from the connect call.
    let ms = |name: &str| stats[name].as_f64().unwrap_or_else(|| panic!("{name}: {stats}"));
    assert!(
        ms("ttff_ms") <= ms("ttff_presented_ms") && ms("settled_ms") <= ms("settled_presented_ms"),
        "{stats}"
    );
    let begun_ms = ms("ttff_since_navigation_ms") - ms("ttff_ms");
    let shown_ms = ms("ttff_presented_since_navigation_ms") - ms("ttff_presented_ms");
    assert!(begun_ms > 0.0 && (begun_ms - shown_ms).abs() < 1.0, "{begun_ms}, {shown_ms}: {stats}");
    assert_eq!(stats["bytes"], stats["total_bytes"], "{stats}");
    for own in ["longest_task_ms", "gpu_bytes", "heap_bytes", "frame_count", "decoders"] {
        assert!(matches!(stats[own], Value::Number(_) | Value::Array(_)), "{own}: {stats}");
    }
    server.assert_healthy();
}
