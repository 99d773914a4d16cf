//! The world from above.

use std::fmt::Write as _;

use maud::{Markup, PreEscaped, html};
use rigsim_physics::Pose;
use rigsim_physics::world::{Feature, FeatureKind, Shape};

use super::frames::{Frames, Path};
use crate::visible;

/// Greatest width of the picture, and its height, in its own units.
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 480.0;
/// Least width and height of what is shown, m.
const LEAST: f64 = 2.0;
/// Room around what is shown, as a part of it.
const MARGIN: f64 = 0.2;
/// Number of colours of a path.
const COLOURS: usize = 16;

/// The part of the plane that is shown, and how large.
struct View {
    low: [f64; 2],
    high: [f64; 2],
    scale: f64,
}

impl View {
    /// Shows all vehicles on their paths, and of the world what is around.
    fn of(frames: &Frames) -> Self {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for path in &frames.paths {
            let reach = path.size[0].max(path.size[1]) / 2.0;
            for Pose { x, y, .. } in &path.poses {
                for (axis, at) in [*x, *y].into_iter().enumerate() {
                    low[axis] = low[axis].min(at - reach);
                    high[axis] = high[axis].max(at + reach);
                }
            }
        }
        for axis in 0..2 {
            if low[axis] > high[axis] {
                (low[axis], high[axis]) = (0.0, 0.0);
            }
            let size = high[axis] - low[axis];
            let more = (size * MARGIN).max((LEAST - size) / 2.0).max(0.5);
            (low[axis], high[axis]) = (low[axis] - more, high[axis] + more);
        }
        let scale = (WIDTH / (high[0] - low[0])).min(HEIGHT / (high[1] - low[1]));
        Self { low, high, scale }
    }

    fn size(&self) -> [f64; 2] {
        [0, 1].map(|axis| (self.high[axis] - self.low[axis]) * self.scale)
    }

    /// Where a point of the plane is in the picture.
    fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [
            (x - self.low[0]) * self.scale,
            (self.high[1] - y) * self.scale,
        ]
    }

    fn points(&self, points: impl IntoIterator<Item = [f64; 2]>) -> String {
        let mut text = String::new();
        for point in points {
            let [x, y] = self.at(point);
            // Writing to a string cannot fail.
            let _ = write!(text, "{x:.1},{y:.1} ");
        }
        text.truncate(text.trim_end().len());
        text
    }
}

/// The map, with the paths of the vehicles and marks where something happened.
pub(super) fn map(frames: &Frames, label: &str) -> Markup {
    let view = View::of(frames);
    let [width, height] = view.size();
    html! {
        svg.map viewBox=(format!("0 0 {width:.0} {height:.0}")) xmlns="http://www.w3.org/2000/svg"
            role="img" aria-label=(label) {
            rect.ground width=(format!("{width:.0}")) height=(format!("{height:.0}")) {}
            @for feature in frames.passing.iter().filter(|one| is_near(&view, one)) {
                (shape(&view, feature, "passing"))
            }
            @for feature in frames.features.iter().filter(|one| is_near(&view, one)) {
                (shape(&view, feature, class(feature.kind)))
            }
            @for path in &frames.paths { (path_of(&view, path)) }
            @for path in &frames.paths { (ends(&view, frames, path)) }
            (faults(&view, frames))
            (failure(&view, frames))
            (scale_bar(&view))
        }
    }
}

/// Explains the colours.
pub(super) fn legend(frames: &Frames) -> Markup {
    let view = View::of(frames);
    let seen = frames.features.iter().filter(|one| is_near(&view, one));
    let kinds: Vec<FeatureKind> = seen.map(|one| one.kind).collect();
    let colours: Vec<String> = (0..COLOURS).map(colour).collect();
    let gradient = format!(
        "background: linear-gradient(to right, {})",
        colours.join(", ")
    );
    html! {
        p.legend {
            "0 s " span.gradient style=(gradient) {} " " (format!("{:.1} s", frames.length()))
            @if !frames.spans.is_empty() { span.key { span.dot.fault {} "a fault begins" } }
            @if frames.failed_at().is_some() { span.key { span.cross { "✕" } "it fails" } }
            @for (kind, name) in [
                (FeatureKind::Obstacle, "wall or obstacle"),
                (FeatureKind::Strip, "magnetic strip"),
                (FeatureKind::Slope, "slope"),
            ] {
                @if kinds.contains(&kind) {
                    span.key { span class=(format!("box {}", class(kind))) {} (name) }
                }
            }
            @if let Some(friction) = slippery(&kinds) {
                span.key { span.box.slippery {} "friction " (friction) }
            }
        }
    }
}

/// The frictions of areas, in words.
fn slippery(kinds: &[FeatureKind]) -> Option<String> {
    let friction = |kind: &FeatureKind| match kind {
        FeatureKind::Friction(friction) => Some(friction.to_string()),
        _ => None,
    };
    let mut all: Vec<String> = kinds.iter().filter_map(friction).collect();
    all.sort();
    all.dedup();
    (!all.is_empty()).then(|| all.join(", "))
}

fn class(kind: FeatureKind) -> &'static str {
    match kind {
        FeatureKind::Slope => "slope",
        FeatureKind::Friction(_) => "slippery",
        FeatureKind::Strip => "strip",
        FeatureKind::Tag(_) => "tag",
        FeatureKind::Obstacle => "obstacle",
    }
}

/// Returns whether any of it can be seen.
fn is_near(view: &View, feature: &Feature) -> bool {
    let (points, reach) = match &feature.shape {
        Shape::Rectangle(rectangle) => (rectangle.corners().to_vec(), 0.0),
        Shape::Disc(disc) => (vec![disc.centre], disc.radius),
        Shape::Band(band) => (band.ends.to_vec(), band.radius),
    };
    (0..2).all(|axis| {
        let at = points.iter().map(|point| point[axis]);
        let least = at.clone().fold(f64::INFINITY, f64::min) - reach;
        let most = at.fold(f64::NEG_INFINITY, f64::max) + reach;
        least <= view.high[axis] && most >= view.low[axis]
    })
}

fn shape(view: &View, feature: &Feature, class: &str) -> Markup {
    let number = |length: f64| format!("{:.1}", length * view.scale);
    match &feature.shape {
        Shape::Rectangle(rectangle) => {
            html! { polygon class=(class) points=(view.points(rectangle.corners())) {} }
        }
        Shape::Disc(disc) => {
            let [x, y] = view.at(disc.centre).map(|at| format!("{at:.1}"));
            html! { circle class=(class) cx=(x) cy=(y) r=(number(disc.radius)) {} }
        }
        Shape::Band(band) => html! {
            polyline class=(format!("{class} band")) points=(view.points(band.ends))
                stroke-width=(number((band.radius * 2.0).max(1.5 / view.scale))) {}
        },
    }
}

/// A colour of equal lightness for each part of the time, from blue over green to red.
fn colour(part: usize) -> String {
    format!("hsl({} 75% 50%)", 225 - part * 225 / (COLOURS - 1))
}

fn path_of(view: &View, path: &Path) -> Markup {
    let count = path.poses.len();
    let part = |part: usize| {
        let from = count * part / COLOURS;
        // Up to the first point of the next part, so that there is no gap.
        let to = (count * (part + 1) / COLOURS + 1).min(count);
        let mut points: Vec<[f64; 2]> = path.poses[from..to]
            .iter()
            .map(|pose| [pose.x, pose.y])
            .collect();
        // Standing still is one point.
        points.dedup_by(|a, b| {
            let apart = [0, 1].map(|axis| (a[axis] - b[axis]).abs() * view.scale);
            apart.iter().all(|apart| *apart < 0.5)
        });
        points
    };
    html! {
        @for (index, points) in (0..COLOURS).map(part).enumerate() {
            @if points.len() > 1 {
                polyline.path stroke=(colour(index)) points=(view.points(points)) {}
            }
        }
    }
}

/// A vehicle as it begins, and as it is when the run fails or ends.
fn ends(view: &View, frames: &Frames, path: &Path) -> Markup {
    let last = frames
        .failed_at()
        .map_or(path.poses.len().saturating_sub(1), |at| frames.look_at(at));
    let body = |Pose { x, y, heading }: Pose, class: &str| {
        let (sin, cos) = heading.sin_cos();
        let [length, width] = path.size.map(|size| size / 2.0);
        let corner =
            |[ahead, left]: [f64; 2]| [x + cos * ahead - sin * left, y + sin * ahead + cos * left];
        // A nose shows where it looks.
        let corners = [
            [length, 0.0],
            [length * 0.7, width],
            [-length, width],
            [-length, -width],
            [length * 0.7, -width],
        ];
        html! { polygon class=(class) points=(view.points(corners.map(corner))) {} }
    };
    let first = path.poses.first().map(|pose| body(*pose, "begins"));
    let end = path.poses.get(last);
    html! {
        (first.unwrap_or_else(|| PreEscaped(String::new())))
        @if let Some(pose) = end {
            (body(*pose, "ends"))
            @if frames.paths.len() > 1 {
                @let [x, y] = view.at([pose.x, pose.y]).map(|at| format!("{at:.1}"));
                text x=(x) y=(y) dy="-8" text-anchor="middle" { (path.name) }
            }
        }
    }
}

fn faults(view: &View, frames: &Frames) -> Markup {
    html! {
        @for span in &frames.spans {
            @if let Some(Pose { x, y, .. }) = frames.paths.get(span.device).and_then(|path| path.poses.get(frames.look_at(span.from))) {
                @let [x, y] = view.at([*x, *y]).map(|at| format!("{at:.1}"));
                circle.fault cx=(x) cy=(y) r="5" {
                    title { (visible::line(&span.name)) " (" (span.fault) ") at " (format!("{:.2} s", span.from)) }
                }
            }
        }
    }
}

fn failure(view: &View, frames: &Frames) -> Markup {
    let Some(at) = frames.failed_at() else {
        return html! {};
    };
    let look = frames.look_at(at);
    html! {
        @for path in &frames.paths {
            @if let Some(Pose { x, y, .. }) = path.poses.get(look) {
                @let [x, y] = view.at([*x, *y]);
                path.failure d=(format!("M{:.1} {:.1}l16 16m0 -16l-16 16", x - 8.0, y - 8.0)) {}
            }
        }
    }
}

/// A bar of a round length.
fn scale_bar(view: &View) -> Markup {
    let [width, height] = view.size();
    let lengths = [
        0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0,
    ];
    let fits = |length: &&f64| **length * view.scale <= width / 3.0;
    let length = lengths.iter().rfind(fits).unwrap_or(&lengths[0]);
    let y = height - 10.0;
    html! {
        path.scale d=(format!("M10 {:.1}v6h{:.1}v-6", y - 6.0, length * view.scale)) {}
        text x="14" y=(format!("{:.1}", y - 5.0)) { (length) " m" }
    }
}
