//! The page, which is in the program.

/// A file of the page: its path, its type, and what is in it.
pub(crate) struct File {
    path: &'static str,
    pub(crate) mime: &'static str,
    pub(crate) text: &'static str,
}

const FILES: &[File] = &[
    File {
        path: "",
        mime: "text/html; charset=utf-8",
        text: include_str!("page/index.html"),
    },
    File {
        path: "page.css",
        mime: "text/css; charset=utf-8",
        text: include_str!("page/page.css"),
    },
    File {
        path: "page.js",
        mime: "text/javascript; charset=utf-8",
        text: include_str!("page/page.js"),
    },
    File {
        path: "link.js",
        mime: "text/javascript; charset=utf-8",
        text: include_str!("page/link.js"),
    },
    File {
        path: "picture.js",
        mime: "text/javascript; charset=utf-8",
        text: include_str!("page/picture.js"),
    },
    File {
        path: "still.js",
        mime: "text/javascript; charset=utf-8",
        text: include_str!("page/still.js"),
    },
    File {
        path: "charts.js",
        mime: "text/javascript; charset=utf-8",
        text: include_str!("page/charts.js"),
    },
    File {
        path: "forms.js",
        mime: "text/javascript; charset=utf-8",
        text: include_str!("page/forms.js"),
    },
];

/// The file at this path.
pub(crate) fn find(path: &[String]) -> Option<&'static File> {
    let [name] = path else { return None };
    FILES.iter().find(|file| file.path == name)
}
