//! The page, which is in the program.

const SCRIPT: &str = "text/javascript; charset=utf-8";

/// The file of the page at this path: its type, and what is in it.
pub(crate) fn find(path: &[String]) -> Option<(&'static str, &'static str)> {
    let [name] = path else { return None };
    Some(match name.as_str() {
        "" => ("text/html; charset=utf-8", include_str!("page/index.html")),
        "page.css" => ("text/css; charset=utf-8", include_str!("page/page.css")),
        "page.js" => (SCRIPT, include_str!("page/page.js")),
        "link.js" => (SCRIPT, include_str!("page/link.js")),
        "picture.js" => (SCRIPT, include_str!("page/picture.js")),
        "still.js" => (SCRIPT, include_str!("page/still.js")),
        "history.js" => (SCRIPT, include_str!("page/history.js")),
        "vehicle.js" => (SCRIPT, include_str!("page/vehicle.js")),
        "save.js" => (SCRIPT, include_str!("page/save.js")),
        "charts.js" => (SCRIPT, include_str!("page/charts.js")),
        "forms.js" => (SCRIPT, include_str!("page/forms.js")),
        _ => return None,
    })
}
