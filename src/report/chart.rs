//! Signals over time as a picture: the machines' states as bands, what happened as marks, and a
//! panel for each unit.
//!
//! In the HTML page, a line follows the pointer and says what was at that moment; the same is at
//! `#reading` and, as `data-time`, at `#chart`.

use plotters::style::RGBColor;
use plotters::style::text_anchor::{HPos, VPos};
use serde_json::json;

use super::OKABE_ITO;
use super::canvas::{self, Canvas, Drawing, INK, LEFT_MIDDLE, MESH, PlotError, SOFT, rgb};
use super::ruler::Ruler;
use super::timeline::{Mark, Signal, Timeline};
use crate::page::inside_script;
use crate::printable::escaped;
use crate::units::{count, rounded_to};

/// The picture's width in layout units, and what is around its panels.
const WIDTH: f64 = 900.0;
const LEFT: f64 = 92.0;
const RIGHT: f64 = 24.0;
const TOP: f64 = 46.0;
/// Below the last panel: the axis of time.
const AXIS: f64 = 54.0;
/// The height of a machine's band, of a row of marks, of a panel with its head, and of a panel's
/// head.
const BAND: f64 = 22.0;
const LANE: f64 = 18.0;
const PANEL: f64 = 142.0;
const HEAD: f64 = 24.0;

/// A row of the legend, in which states have their colours.
const ROW: f64 = 22.0;

/// Letters in the left margin, and in the legend of a panel.
const LABEL_LETTERS: usize = 11;
const NAME_LETTERS: usize = 24;

/// With more transitions than this, lines through all panels would hide what is in them.
const MOST_GUIDES: usize = 60;

/// The most ticks in a page.
const MOST_TICKS: usize = 20_000;

const TEMPLATE: &str = include_str!("chart.html");

impl<'t> Band<'t> {
    /// The states, in the order in which they were entered first.
    fn states(&self) -> Vec<&'t str> {
        let mut states = Vec::new();
        for (_, _, state) in &self.spans {
            if !states.contains(state) {
                states.push(*state);
            }
        }
        states
    }
}

/// Signals of a run, drawn over time.
#[derive(Debug)]
pub struct Chart<'t> {
    title: String,
    timeline: &'t Timeline,
    panels: Vec<Panel<'t>>,
    bands: Vec<Band<'t>>,
    lanes: Vec<(&'static str, Vec<&'t Mark>)>,
}

/// Signals of one unit.
#[derive(Debug)]
struct Panel<'t> {
    unit: &'static str,
    signals: Vec<&'t Signal>,
}

/// A machine's states: from when, until when, which.
#[derive(Debug)]
struct Band<'t> {
    machine: &'t str,
    spans: Vec<(f64, f64, &'t str)>,
}

impl<'t> Chart<'t> {
    /// A chart of these signals.
    #[must_use]
    pub fn new(timeline: &'t Timeline, signals: &[&'t Signal], title: Option<&str>) -> Self {
        let mut panels: Vec<Panel<'t>> = Vec::new();
        for signal in signals.iter().copied() {
            let unit = signal.unit();
            // Numbers without a unit have no scale in common.
            match panels.iter_mut().find(|panel| panel.unit == unit && !unit.is_empty()) {
                Some(panel) => panel.signals.push(signal),
                None => panels.push(Panel { unit, signals: vec![signal] }),
            }
        }
        let of_machines = timeline.texts.iter().take(timeline.machines);
        let bands = of_machines.map(|texts| Band {
            machine: texts.name.strip_suffix(".state").unwrap_or(&texts.name),
            spans: spans(&timeline.times_s, &texts.values),
        });
        let lanes = Mark::KINDS.into_iter().filter_map(|kind| {
            let marks: Vec<&Mark> =
                timeline.marks.iter().filter(|mark| mark.kind == kind).collect();
            (!marks.is_empty()).then_some((kind, marks))
        });
        let named = || format!("{}: {}", timeline.robot, timeline.mission);
        Self {
            title: title.map_or_else(named, str::to_owned),
            timeline,
            panels,
            bands: bands.collect(),
            lanes: lanes.collect(),
        }
    }

    /// As SVG, 900 wide.
    ///
    /// # Errors
    ///
    /// [`PlotError::Draw`].
    pub fn svg(&self) -> Result<String, PlotError> {
        canvas::svg(self)
    }

    /// As PNG, 1350 pixels wide.
    ///
    /// # Errors
    ///
    /// See [`PlotError`].
    pub fn png(&self) -> Result<Vec<u8>, PlotError> {
        canvas::png(self)
    }

    /// As PDF, a page of its size.
    ///
    /// # Errors
    ///
    /// [`PlotError::Draw`].
    pub fn pdf(&self) -> Result<Vec<u8>, PlotError> {
        canvas::pdf(self)
    }

    /// As one HTML page that needs nothing else.
    ///
    /// # Errors
    ///
    /// [`PlotError::Draw`].
    pub fn html(&self) -> Result<String, PlotError> {
        let every = self.timeline.times_s.len().div_ceil(MOST_TICKS).max(1);
        let round = |value: &f64| value.is_finite().then(|| rounded_to(*value, 1e4));
        let signals = self.panels.iter().flat_map(|panel| &panel.signals).map(|signal| {
            let values: Vec<Option<f64>> = signal.values.iter().step_by(every).map(round).collect();
            json!({ "name": signal.name, "unit": signal.unit(), "values": values })
        });
        let machines =
            self.bands.iter().map(|band| json!({ "name": band.machine, "spans": band.spans }));
        let marks = self.timeline.marks.iter();
        let data = json!({
            "left": LEFT,
            "right": RIGHT,
            "width": WIDTH,
            "duration": self.duration_s(),
            "times": self.timeline.times_s.iter().step_by(every).map(round).collect::<Vec<_>>(),
            "signals": signals.collect::<Vec<_>>(),
            "machines": machines.collect::<Vec<_>>(),
            "marks": marks.map(|mark| (mark.time_s, mark.kind, &mark.text)).collect::<Vec<_>>(),
        });
        let svg = self.svg()?;
        let page = TEMPLATE.replace("@TITLE@", &escaped(&self.title));
        let page = page.replace("\"@DATA@\"", &inside_script(&data.to_string()));
        Ok(page.replace("@SVG@", &svg))
    }

    fn duration_s(&self) -> f64 {
        self.timeline.duration_s().max(0.1)
    }

    fn x(&self, time_s: f64) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * (time_s / self.duration_s()).clamp(0.0, 1.0)
    }

    /// Where the first panel begins.
    fn panels_top(&self) -> f64 {
        TOP + BAND * count(self.bands.len()) + LANE * count(self.lanes.len()) + 8.0
    }

    fn bottom(&self) -> f64 {
        self.panels_top() + PANEL * count(self.panels.len())
    }
}

/// Where texts stay the same; what is empty is no span.
fn spans<'t>(times_s: &[f64], texts: &'t [String]) -> Vec<(f64, f64, &'t str)> {
    let mut spans: Vec<(f64, f64, &'t str)> = Vec::new();
    let mut before = "";
    for (&time_s, text) in times_s.iter().zip(texts) {
        if let Some(last) = spans.last_mut().filter(|_| !before.is_empty()) {
            last.1 = time_s;
        }
        if text != before && !text.is_empty() {
            spans.push((time_s, time_s, text));
        }
        before = text;
    }
    spans
}

impl Drawing for Chart<'_> {
    fn size(&self) -> [f64; 2] {
        [WIDTH, self.bottom() + AXIS + ROW * count(self.bands.len()) + 8.0]
    }

    fn draw(&self, canvas: &mut Canvas) {
        let middle = LEFT + (WIDTH - LEFT - RIGHT) / 2.0;
        canvas.title(&self.title, middle, 2.0 * middle.min(WIDTH - middle));
        let times = Ruler::over(0.0, self.duration_s(), 9.0);
        let mut top = self.panels_top();
        for panel in &self.panels {
            self.panel(canvas, panel, top, &times);
            top += PANEL;
        }
        for time_s in times.marks() {
            let place = [self.x(time_s), top + 7.0];
            canvas.text(&times.label(time_s), place, 14.0, SOFT, (HPos::Center, VPos::Top));
        }
        let axis = (HPos::Center, VPos::Top);
        canvas.text("time in seconds", [middle, top + 28.0], 14.0, SOFT, axis);
        for (row, band) in self.bands.iter().enumerate() {
            self.band(canvas, band, TOP + BAND * count(row));
            self.legend(canvas, band, self.bottom() + AXIS + ROW * (count(row) + 0.5));
        }
        let mut top = TOP + BAND * count(self.bands.len());
        for (kind, marks) in &self.lanes {
            self.lane(canvas, kind, marks, top);
            top += LANE;
        }
    }
}

impl Chart<'_> {
    fn label(&self, canvas: &mut Canvas, label: &str, y: f64) {
        let label: String = label.chars().take(LABEL_LETTERS).collect();
        canvas.text(&label, [LEFT - 8.0, y], 13.0, SOFT, (HPos::Right, VPos::Center));
    }

    fn band(&self, canvas: &mut Canvas, band: &Band<'_>, top: f64) {
        let middle = top + BAND / 2.0;
        self.label(canvas, band.machine, middle);
        let states = band.states();
        for (from_s, to_s, state) in &band.spans {
            let place = states.iter().position(|known| known == state).unwrap_or(0);
            let (from, to) = (self.x(*from_s), self.x(*to_s));
            let colour = tint(OKABE_ITO[place % OKABE_ITO.len()]);
            canvas.rectangle([from, top + 2.0], [to, top + BAND - 2.0], colour);
            canvas.line(&[[from, top + 2.0], [from, top + BAND - 2.0]], SOFT, 1.0);
            if canvas.text_width(state, 12.0) + 8.0 < to - from {
                canvas.text(state, [from + 5.0, middle], 12.0, INK, LEFT_MIDDLE);
            }
        }
    }

    /// Which colour a machine's states have: those that there is room for.
    fn legend(&self, canvas: &mut Canvas, band: &Band<'_>, y: f64) {
        self.label(canvas, band.machine, y);
        let mut x = LEFT;
        for (place, state) in band.states().into_iter().enumerate() {
            let width = canvas.text_width(state, 13.0);
            if x + 22.0 + width > WIDTH - RIGHT {
                return canvas.text("...", [x, y], 13.0, INK, LEFT_MIDDLE);
            }
            let colour = tint(OKABE_ITO[place % OKABE_ITO.len()]);
            canvas.rectangle([x, y - 6.0], [x + 16.0, y + 6.0], colour);
            canvas.text(state, [x + 22.0, y], 13.0, INK, LEFT_MIDDLE);
            x += 22.0 + width + 18.0;
        }
    }

    fn lane(&self, canvas: &mut Canvas, kind: &str, marks: &[&Mark], top: f64) {
        let middle = top + LANE / 2.0;
        self.label(canvas, kind, middle);
        canvas.line(&[[LEFT, middle], [WIDTH - RIGHT, middle]], MESH, 1.0);
        let mut last = LEFT;
        for (index, mark) in marks.iter().enumerate() {
            let x = self.x(mark.time_s);
            let diamond =
                [[x, middle - 5.0], [x + 4.0, middle], [x, middle + 5.0], [x - 4.0, middle]];
            canvas.polygon(&diamond, rgb(OKABE_ITO[0]));
            // What there is no room for is in the page, and in the table.
            let next = marks.get(index + 1).map_or(WIDTH - RIGHT, |next| self.x(next.time_s) - 4.0);
            let width = canvas.text_width(&mark.text, 12.0);
            let mut end = x + 4.0;
            if width + 12.0 < next - x {
                canvas.text(&mark.text, [x + 7.0, middle], 12.0, INK, LEFT_MIDDLE);
                end = x + 7.0 + width;
            } else if index + 1 == marks.len() && width + 12.0 < x - last {
                let right = (HPos::Right, VPos::Center);
                canvas.text(&mark.text, [x - 7.0, middle], 12.0, INK, right);
            }
            last = end;
        }
    }

    fn panel(&self, canvas: &mut Canvas, panel: &Panel<'_>, top: f64, times: &Ruler) {
        let (low_y, high_y, right) = (top + PANEL - 4.0, top + HEAD, WIDTH - RIGHT);
        let (low, high) = panel.span();
        let values = Ruler::over(low, high, (low_y - high_y) / 26.0);
        let y = |value: f64| low_y - (low_y - high_y) * (value - low) / (high - low);
        for time_s in times.marks() {
            let x = self.x(time_s);
            canvas.line(&[[x, high_y], [x, low_y]], MESH, 1.0);
        }
        for value in values.marks() {
            canvas.line(&[[LEFT, y(value)], [right, y(value)]], MESH, 1.0);
            let place = [LEFT - 8.0, y(value)];
            canvas.text(&values.label(value), place, 13.0, SOFT, (HPos::Right, VPos::Center));
        }
        let guides: usize = self.bands.iter().map(|band| band.spans.len()).sum();
        for band in self.bands.iter().filter(|_| guides <= MOST_GUIDES) {
            for (from_s, ..) in band.spans.iter().skip(1) {
                let x = self.x(*from_s);
                canvas.dashed(&[[x, high_y], [x, low_y]], GUIDE, 1.0, 3.0);
            }
        }
        let frame =
            [[LEFT, high_y], [right, high_y], [right, low_y], [LEFT, low_y], [LEFT, high_y]];
        canvas.line(&frame, SOFT, 1.0);
        let mut x = LEFT;
        for (place, signal) in panel.signals.iter().enumerate() {
            let colour = rgb(LINES[place % LINES.len()]);
            // What lies on another line does not hide it.
            let excess = 1.4 * count((panel.signals.len() - place - 1).min(2));
            for line in self.lines(signal, y) {
                canvas.line(&line, colour, 1.6 + excess);
                if let [only] = line.as_slice() {
                    canvas.dot(*only, 1.2, colour);
                }
            }
            let head = top + HEAD / 2.0 + 1.0;
            canvas.line(&[[x, head], [x + 18.0, head]], colour, 2.5);
            let mut name: String = signal.name.chars().take(NAME_LETTERS).collect();
            if place + 1 == panel.signals.len() && !panel.unit.is_empty() {
                name = format!("{name}   in {}", panel.unit);
            }
            canvas.text(&name, [x + 24.0, head], 14.0, INK, LEFT_MIDDLE);
            x += 24.0 + canvas.text_width(&name, 14.0) + 22.0;
        }
    }

    /// A signal as lines, one for each time during which it was known; of what falls on half a unit
    /// of the picture, the first, the least, the greatest and the last.
    fn lines(&self, signal: &Signal, y: impl Fn(f64) -> f64) -> Vec<Vec<[f64; 2]>> {
        // Of each line its columns.
        let mut lines: Vec<Vec<Vec<[f64; 2]>>> = Vec::new();
        let mut before = f64::NAN;
        for (time_s, &value) in self.timeline.times_s.iter().zip(&signal.values) {
            let wraps = signal.name == "heading_deg" && (before - value).abs() > 300.0;
            let begins = before.is_nan() || wraps;
            before = value;
            if value.is_nan() {
                continue;
            }
            if begins {
                lines.push(Vec::new());
            }
            let place = [self.x(*time_s), y(value)];
            let Some(columns) = lines.last_mut() else { continue };
            match columns.last_mut() {
                Some(column) if place[0] - column[0][0] < 0.5 => column.push(place),
                _ => columns.push(vec![place]),
            }
        }
        let line = |columns: &Vec<Vec<[f64; 2]>>| {
            columns.iter().flat_map(|column| thinned(column)).collect()
        };
        lines.iter().map(line).collect()
    }
}

/// Of points that fall on one place of the axis of time: the first, the least, the greatest, the
/// last, in their order.
fn thinned(column: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let by_y =
        |one: &(usize, &[f64; 2]), other: &(usize, &[f64; 2])| one.1[1].total_cmp(&other.1[1]);
    let least = column.iter().enumerate().min_by(by_y).map(|found| found.0);
    let greatest = column.iter().enumerate().max_by(by_y).map(|found| found.0);
    let is_kept = |place: usize| {
        place == 0 || place + 1 == column.len() || Some(place) == least || Some(place) == greatest
    };
    column
        .iter()
        .enumerate()
        .filter(|(place, _)| is_kept(*place))
        .map(|(_, point)| *point)
        .collect()
}

/// The colours of lines: all but the yellow, which is too light for one.
const LINES: &[[u8; 3]] = OKABE_ITO.split_at(6).0;

/// Where a machine changed its state.
const GUIDE: RGBColor = RGBColor(0xb4, 0xba, 0xc1);

/// A light form of a colour, on which text can be read.
fn tint(colour: [u8; 3]) -> RGBColor {
    rgb(colour.map(|part| 255 - (255 - part) / 3))
}

impl Panel<'_> {
    /// The least and the greatest value, with room around them.
    fn span(&self) -> (f64, f64) {
        let values = self.signals.iter().flat_map(|signal| &signal.values);
        let values = values.copied().filter(|value| value.is_finite());
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        });
        if low > high {
            return (0.0, 1.0);
        }
        // What hardly changes is shown as a level line.
        let margin = ((high - low) * 0.08).max(high.abs() * 1e-3).max(1e-3);
        (low - margin, high + margin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_are_spans_and_what_is_not_known_is_none() {
        let texts = ["", "a", "a", "b", "", "b"].map(str::to_owned);
        let times = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        assert_eq!(spans(&times, &texts), [(1.0, 3.0, "a"), (3.0, 4.0, "b"), (5.0, 5.0, "b")]);
    }

    #[test]
    fn thinning_keeps_the_peaks() {
        let column = [[0.0, 1.0], [0.1, 9.0], [0.2, 2.0], [0.3, -5.0], [0.4, 1.0]];
        assert_eq!(thinned(&column), [column[0], column[1], column[3], column[4]]);
        assert_eq!(thinned(&[]), [[0.0; 2]; 0]);
    }

    #[test]
    fn a_heading_is_not_joined_across_its_wrap_nor_a_signal_across_a_gap() {
        let timeline =
            Timeline { times_s: vec![0.0, 10.0, 20.0, 30.0, 40.0, 50.0], ..Timeline::default() };
        let values = vec![170.0, 179.0, -179.0, -170.0, f64::NAN, -160.0];
        let heading = Signal { name: "heading_deg".to_owned(), values };
        let chart = Chart::new(&timeline, &[&heading], None);
        let lengths: Vec<usize> = chart.lines(&heading, |y| y).iter().map(Vec::len).collect();
        assert_eq!(lengths, [2, 2, 1]);
    }
}
