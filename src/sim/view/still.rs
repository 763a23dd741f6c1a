//! A still of a simulation as SVG: the picture of the live page, for a file.

use std::fmt::Write as _;

use super::{Mark, MarkKind, Paint, RobotView, Room, View, web_colour};
use crate::printable::escaped;
use crate::sim::Simulation;
use crate::units::{bounds, count, radians};

/// Width of the picture, pixels; the height follows the room.
const WIDTH: f64 = 800.0;
/// Above the room, for the title.
const HEAD: f64 = 44.0;
/// The tallest that the room is drawn.
const TALLEST: f64 = 800.0;
/// A line of text below the room.
const LINE: f64 = 20.0;
const PAD: f64 = 16.0;

/// One colour a robot, the first again after the last: path, echoes.
const COLOURS: [(&str, &str); 6] = [
    ("#1a934a", "#d62a2f"),
    ("#1f6fd0", "#b8590b"),
    ("#7a3fc0", "#c02a86"),
    ("#0b8a8f", "#a06a00"),
    ("#5a6a00", "#8a2be2"),
    ("#444d57", "#d0442f"),
];

/// A simulation as SVG, 800 pixels wide; what has gathered since [`Simulation::watch`] is in it.
/// Empty of robots where the physics is not a [`WorldPhysics`](crate::sim::WorldPhysics).
#[must_use]
pub fn still(simulation: &Simulation) -> String {
    let empty = Room {
        name: "no world".to_owned(),
        low: [-1.0; 2],
        high: [1.0; 2],
        walls: Vec::new(),
        floor: Vec::new(),
    };
    let nothing =
        View { time_s: 0.0, robots: Vec::new(), marks: Vec::new(), next: 0, done: Vec::new() };
    Picture::new(simulation.room().unwrap_or(empty), simulation.view(0).unwrap_or(nothing)).draw()
}

struct Picture {
    room: Room,
    view: View,
    low: [f64; 2],
    high: [f64; 2],
    scale: f64,
    svg: String,
}

impl Picture {
    fn new(room: Room, view: View) -> Self {
        let places = view.robots.iter().flat_map(|robot| robot.outline);
        let marks = view.marks.iter().map(|mark| [mark.x_m, mark.y_m]);
        let places = super::widened(places.chain(marks), super::MARGIN_M);
        let [low, high] = bounds([room.low, room.high].into_iter().chain(places));
        let [wide, tall] = [high[0] - low[0], high[1] - low[1]];
        let scale = ((WIDTH - 2.0 * PAD) / wide.max(0.1)).min(TALLEST / tall.max(0.1));
        Self { room, view, low, high, scale, svg: String::new() }
    }

    fn draw(mut self) -> String {
        let bottom = HEAD + (self.high[1] - self.low[1]) * self.scale;
        let lines: Vec<(String, &str)> = self.text();
        let height = bottom + PAD + LINE * count(lines.len()) + PAD;
        let title = format!("{}, after {:.1} s", self.room.name, self.view.time_s);
        self.put(format_args!(
            "<svg width=\"{WIDTH}\" height=\"{height:.0}\" viewBox=\"0 0 {WIDTH} {height:.0}\" \
             xmlns=\"http://www.w3.org/2000/svg\" font-family=\"system-ui, Ubuntu, DejaVu Sans, \
             sans-serif\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n\
             <text x=\"{PAD}\" y=\"29\" font-size=\"20\" font-weight=\"600\" \
             fill=\"#22262b\">{}</text>\n",
            escaped(&title)
        ));
        self.draw_room();
        self.draw_marks();
        for (number, robot) in self.view.robots.clone().iter().enumerate() {
            self.draw_robot(number, robot);
        }
        for (index, (line, colour)) in lines.iter().enumerate() {
            let y = bottom + PAD + LINE * (count(index) + 0.7);
            self.put(format_args!(
                "<text x=\"{PAD}\" y=\"{y:.0}\" font-size=\"14\" fill=\"{colour}\" \
                 xml:space=\"preserve\">{}</text>\n",
                escaped(line)
            ));
        }
        self.svg.push_str("</svg>\n");
        self.svg
    }

    fn draw_room(&mut self) {
        for Paint { points, width_m, closed, colour } in std::mem::take(&mut self.room.floor) {
            let path = self.path(points.iter().copied(), closed);
            let colour = web_colour(colour);
            match width_m {
                Some(width_m) => {
                    let width = width_m * self.scale;
                    self.put(format_args!(
                        "<path class=\"floor\" d=\"{path}\" fill=\"none\" stroke=\"{colour}\" \
                         stroke-width=\"{width:.1}\"/>\n"
                    ));
                }
                None => self.put(format_args!(
                    "<path class=\"floor\" d=\"{path}\" fill=\"{colour}\" stroke=\"#c4cad1\"/>\n"
                )),
            }
        }
        for wall in std::mem::take(&mut self.room.walls) {
            let closed = wall.len() > 2 && wall.first() == wall.last();
            let path = self.path(wall.into_iter(), closed);
            let fill = if closed { "#e3e6ea" } else { "none" };
            self.put(format_args!(
                "<path class=\"wall\" d=\"{path}\" fill=\"{fill}\" stroke=\"#8b939c\" \
                 stroke-width=\"2.5\" stroke-linejoin=\"round\"/>\n"
            ));
        }
    }

    fn draw_marks(&mut self) {
        for robot in 0..self.view.robots.len() {
            let (path_colour, echo_colour) = colours(robot);
            let of = |kind: MarkKind| {
                let own = move |mark: &&Mark| mark.robot == robot && mark.kind == kind;
                self.view.marks.iter().filter(own).map(|mark| [mark.x_m, mark.y_m])
            };
            let mut dots = String::new();
            for [x, y] in of(MarkKind::Echo).map(|place| self.place(place)) {
                let _ = write!(dots, "M{x:.1} {y:.1}h0");
            }
            let path = self.path(of(MarkKind::Path), false);
            self.put(format_args!(
                "<path class=\"echoes\" d=\"{dots}\" fill=\"none\" stroke=\"{echo_colour}\" \
                 stroke-opacity=\"0.75\" \
                 stroke-width=\"3.6\" stroke-linecap=\"round\"/>\n\
                 <path class=\"path\" d=\"{path}\" fill=\"none\" stroke=\"{path_colour}\" \
                 stroke-width=\"2.2\"/>\n"
            ));
        }
    }

    fn draw_robot(&mut self, number: usize, robot: &RobotView) {
        let (colour, _) = colours(number);
        if let Some(beam) = robot.beam {
            // Without an echo the cone is shown as far as a person would look for one.
            let range_m = beam.echo_m.unwrap_or(1.0);
            let edge = |degrees: f64| {
                let (sin, cos) = libm::sincos(radians(degrees));
                [beam.from[0] + cos * range_m, beam.from[1] + sin * range_m]
            };
            let arc =
                (-6..=6).map(|part| edge(beam.axis_deg + beam.half_deg * f64::from(part) / 6.0));
            let path = self.path(std::iter::once(beam.from).chain(arc), true);
            let seen = if beam.echo_m.is_some() { 0.28 } else { 0.10 };
            self.put(format_args!(
                "<path class=\"beam\" d=\"{path}\" fill=\"#e2a100\" fill-opacity=\"{seen}\"/>\n"
            ));
        }
        let body = self.path(robot.outline.into_iter(), true);
        let stroke = if robot.faults.is_empty() { "#ffffff" } else { "#d62a2f" };
        self.put(format_args!(
            "<path class=\"robot\" d=\"{body}\" fill=\"{colour}\" stroke=\"{stroke}\" \
             stroke-width=\"2\" stroke-linejoin=\"round\"/>\n"
        ));
        let nose = |along: f64, aside: f64| {
            let (sin, cos) = libm::sincos(radians(robot.heading_deg));
            [robot.x_m + cos * along - sin * aside, robot.y_m + sin * along + cos * aside]
        };
        let arrow =
            self.path([nose(0.07, 0.0), nose(0.02, 0.035), nose(0.02, -0.035)].into_iter(), true);
        let [x, y] = self.place([robot.x_m, robot.y_m]);
        self.put(format_args!("<path class=\"heading\" d=\"{arrow}\" fill=\"#ffffff\"/>\n"));
        if self.view.robots.len() > 1 {
            let label = number + 1;
            self.put(format_args!(
                "<text x=\"{x:.1}\" y=\"{:.1}\" font-size=\"13\" font-weight=\"600\" \
                 fill=\"#22262b\">{label}</text>\n",
                y - 0.13 * self.scale
            ));
        }
    }

    /// The lines below the room, each with its colour.
    fn text(&self) -> Vec<(String, &'static str)> {
        let mut lines = Vec::new();
        for (number, robot) in self.view.robots.iter().enumerate() {
            lines.push((
                format!(
                    "robot {}: x {:.2} m, y {:.2} m, heading {:.0}°, head {:.0}°, {:.2} m driven, \
                     battery {:.2} V{}{}",
                    number + 1,
                    robot.x_m,
                    robot.y_m,
                    robot.heading_deg,
                    robot.head_deg,
                    robot.travelled_m,
                    robot.battery_v,
                    if robot.touching { ", touching" } else { "" },
                    if robot.fallen { ", fallen" } else { "" },
                ),
                colours(number).0,
            ));
            let devices = robot
                .devices
                .iter()
                .map(|device| format!("{} {} {}", device.port, device.what, device.told));
            let devices: Vec<String> = devices.collect();
            lines.extend(
                devices.chunks(4).map(|four| (format!("    {}", four.join("   ")), "#5d6670")),
            );
            if !robot.faults.is_empty() {
                lines.push((format!("    faults: {}", robot.faults.join(", ")), "#d62a2f"));
            }
        }
        lines.extend(self.view.done.iter().map(|done| (format!("    done at {done}"), "#5d6670")));
        lines
    }

    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let middle = (WIDTH - (self.high[0] - self.low[0]) * self.scale) / 2.0;
        [middle + (x - self.low[0]) * self.scale, HEAD + (self.high[1] - y) * self.scale]
    }

    fn path(&self, places: impl Iterator<Item = [f64; 2]>, closed: bool) -> String {
        let mut path = String::new();
        for (index, [x, y]) in places.map(|place| self.place(place)).enumerate() {
            let _ = write!(path, "{}{x:.1} {y:.1}", if index == 0 { 'M' } else { 'L' });
        }
        path + if closed { "Z" } else { "" }
    }

    fn put(&mut self, text: std::fmt::Arguments<'_>) {
        // Writing to a string does not fail.
        let _ = self.svg.write_fmt(text);
    }
}

fn colours(robot: usize) -> (&'static str, &'static str) {
    COLOURS.get(robot % COLOURS.len()).copied().unwrap_or(("#1a934a", "#d62a2f"))
}
