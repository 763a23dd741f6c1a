//! Tests of the report: pictures that show what was recorded, exports that others read.
#![cfg(feature = "host")]

use std::path::Path;

use onbrick::clock::{Clock, MonotonicClock, SECOND_NS, seconds};
use onbrick::mapping::MapPoint;
use onbrick::recording::{Grid, Run};
use onbrick::report::export::NamedRecording;
use onbrick::report::{PathPoint, Scene, Track, export, plot};
use onbrick::sim::Paint;

use crate::recording::decoder::python;
use crate::recording::sample::{grid, sample, tick, walls};
use crate::support::browser;

fn one() -> Scene {
    let run = Run::read(&sample(1_500, 1_000_000_000)).unwrap();
    let track = Track::of_run(&run, "run");
    let block = vec![[0.6, -0.7], [0.8, -0.7], [0.8, -0.4], [0.6, -0.4], [0.6, -0.7]];
    Scene {
        title: "mapper: map <the room> & back".to_owned(),
        tracks: vec![track],
        outlines: vec![walls(), block],
        ..Scene::default()
    }
}

/// Two more robots whose runs are the first one's, moved.
fn several() -> Scene {
    let mut scene = one();
    for (name, dx, dy) in [("ada", 0.25, -0.5), ("grace", -0.3, 0.2)] {
        let mut track = scene.tracks[0].clone();
        track.name = name.to_owned();
        for p in &mut track.path {
            (p.x_m, p.y_m) = (p.x_m * 0.6 + dx, p.y_m * 0.6 + dy);
        }
        scene.tracks.push(track);
    }
    scene.title = "three robots".to_owned();
    scene
}

/// Where a picture is kept to be looked at, if `ONBRICK_PICTURES` names a folder.
fn keep(name: &str, bytes: &[u8]) {
    if let Some(folder) = std::env::var_os("ONBRICK_PICTURES") {
        std::fs::write(Path::new(&folder).join(name), bytes).unwrap();
    }
}

#[test]
fn an_svg_has_every_point_the_path_the_walls_and_its_title() {
    let scene = one();
    let svg = plot::svg(&scene).unwrap();
    keep("one.svg", svg.as_bytes());
    assert!(svg.starts_with("<svg width=\"800\" height=\""), "{}", &svg[..200]);
    // Besides the points: three in the legend, two circles for each of the two start marks.
    let circles = svg.matches("<circle").count();
    assert_eq!(circles, scene.tracks[0].points.len() + 3 + 4);
    assert!(svg.contains("mapper: map &lt;the room&gt; &amp; back"));
    for word in ["path", "points", "start", "end", "true walls", "x in metres"] {
        assert!(svg.contains(&format!("\n{word}\n")), "{word} is not in the picture");
    }
    assert_eq!(svg, plot::svg(&scene).unwrap(), "the same scene gives the same picture");
}

/// The pixels of a PNG: width, and red, green, blue of each.
fn pixels(bytes: &[u8]) -> (usize, Vec<[u8; 3]>) {
    let mut reader = png::Decoder::new(bytes).read_info().unwrap();
    let mut data = vec![0; reader.output_buffer_size()];
    let info = reader.next_frame(&mut data).unwrap();
    (info.width as usize, data.as_chunks::<3>().0.to_vec())
}

#[test]
fn a_png_has_vermilion_points_a_blue_path_and_grey_walls() {
    let scene = one();
    let started_ns = MonotonicClock.now_ns();
    let bytes = plot::png(&scene).unwrap();
    println!("drawn in {} ms", (MonotonicClock.now_ns() - started_ns) / 1_000_000);
    keep("one.png", &bytes);
    keep("several.png", &plot::png(&several()).unwrap());
    let (width, pixels) = pixels(&bytes);
    assert_eq!(width, 1200);
    let count = |wanted: [u8; 3]| pixels.iter().filter(|pixel| **pixel == wanted).count();
    let (red, blue, grey) =
        (count([0xd5, 0x5e, 0x00]), count([0x00, 0x72, 0xb2]), count([0x9a, 0xa1, 0xa9]));
    println!("{red} vermilion, {blue} blue, {grey} grey of {} pixels", pixels.len());
    assert!(red > 2_000 && blue > 1_000 && grey > 5_000, "{red} {blue} {grey}");
}

#[test]
fn blocks_that_touch_have_one_outline_and_robots_on_one_path_are_both_seen() {
    let square = |x: f64| vec![[x, 0.0], [x + 0.4, 0.0], [x + 0.4, 0.4], [x, 0.4]];
    let outline = |x: f64| {
        let mut corners = square(x);
        corners.push(corners[0]);
        corners
    };
    let count = |scene: &Scene, wanted: [u8; 3], within: u8| {
        let (_, pixels) = pixels(&plot::png(scene).unwrap());
        // At its rim a shape is mixed with what it lies on.
        let is_like = |pixel: &&[u8; 3]| {
            pixel.iter().zip(wanted).all(|(part, wanted)| part.abs_diff(wanted) <= within)
        };
        pixels.iter().filter(is_like).count()
    };
    let mut scene = Scene {
        outlines: vec![outline(0.0), outline(0.4)],
        blocks: vec![square(0.0), square(0.4)],
        ..Scene::default()
    };
    let wall = [0x9a, 0xa1, 0xa9];
    let together = count(&scene, wall, 0);
    scene.blocks.clear();
    assert!(together > 500 && together < count(&scene, wall, 0) / 2, "{together} grey pixels");
    // Two robots that drove and found the same.
    let path = [0.1, 0.7].map(|x_m| PathPoint { time_ns: 0, x_m, y_m: 0.2, heading_rad: 0.0 });
    let track = Track {
        path: path.to_vec(),
        points: vec![MapPoint { time_ns: 0, x_m: 0.4, y_m: 0.3 }],
        ..Track::default()
    };
    scene.tracks = vec![track; 2];
    let colours = [[0x00, 0x40, 0x64], [0x81, 0x58, 0x00], [0x00, 0x72, 0xb2], [0xe6, 0x9f, 0x00]];
    let seen = colours.map(|colour| count(&scene, colour, 40));
    for track in &mut scene.tracks {
        // The same place, so that the picture keeps its scale.
        track.path.truncate(1);
        track.points.clear();
    }
    for (colour, seen) in colours.into_iter().zip(seen) {
        let legend = count(&scene, colour, 40);
        assert!(seen > legend + 4, "{colour:?}: {seen} pixels, {legend} of them in the legend");
    }
}

/// With a patch and a line on the floor, a table's edge, and a true path beside the path.
fn on_a_table() -> Scene {
    let mut scene = one();
    scene.edges = vec![vec![[-1.0, -1.0], [1.5, -1.0], [1.5, 1.0], [-1.0, 1.0]]];
    let red = [0xff, 0x00, 0x00];
    let mark = |points, width_m, closed| Paint { points, width_m, closed, colour: red };
    scene.marks = vec![
        mark(vec![[0.0, 0.0], [0.2, 0.0], [0.2, 0.2]], None, true),
        mark(vec![[0.0, 0.5], [0.4, 0.5]], Some(0.02), false),
    ];
    scene.tracks[0].truth = scene.tracks[0].path.iter().map(|p| [p.x_m + 0.02, p.y_m]).collect();
    scene
}

#[test]
fn a_floor_has_its_marks_and_its_edge_and_the_true_path_is_dashed() {
    let without = plot::svg(&one()).unwrap();
    let with = plot::svg(&on_a_table()).unwrap();
    keep("floor.svg", with.as_bytes());
    for word in ["true path", "edge of the floor"] {
        assert!(with.contains(&format!("\n{word}\n")) && !without.contains(word), "{word}");
    }
    assert!(with.contains("fill=\"#FF8080\"") || with.contains("fill=\"#FF7F7F\""), "a pale red");
    let lines = |svg: &str| svg.matches("<polyline").count();
    assert!(lines(&with) > lines(&without) + 20, "{} {}", lines(&with), lines(&without));
}

#[test]
fn a_pdf_is_a_page_with_the_font_inside() {
    let bytes = plot::pdf(&one()).unwrap();
    keep("one.pdf", &bytes);
    let text = String::from_utf8_lossy(&bytes);
    assert!(text.starts_with("%PDF-1.") && text.trim_end().ends_with("%%EOF"));
    assert!(text.contains("Ubuntu-Light") && text.contains("/MediaBox [0 0 800 "));
}

#[test]
fn nothing_and_what_is_not_finite_is_a_picture_too() {
    let odd = Track {
        path: vec![PathPoint { time_ns: 0, x_m: 1.0, y_m: 1.0, heading_rad: 0.0 }],
        points: vec![MapPoint { time_ns: 0, x_m: 1e9, y_m: -1e9 }],
        ..Track::default()
    };
    let far = Track { truth: vec![[0.0, 0.0], [1.7e308, -1.7e308]], ..odd.clone() };
    for tracks in [vec![], vec![odd], vec![far]] {
        let scene = Scene { tracks, ..Scene::default() };
        let svg = plot::svg(&scene).unwrap();
        assert!(svg.contains("</svg>"));
        let lines = svg.split("<polyline").skip(1).filter_map(|line| line.split_once("points=\""));
        for (_, line) in lines {
            let places = line.split_once('"').unwrap().0;
            assert!(places.matches(',').count() > 1, "no line: {places}");
        }
        assert!(!plot::png(&scene).unwrap().is_empty());
        assert!(plot::html(&scene).contains("</html>"));
    }
}

#[test]
fn a_cut_recording_is_still_a_picture_and_the_page_says_so() {
    let bytes = sample(500, 1_000_000_000);
    let run = Run::read(&bytes[..bytes.len() / 2]).unwrap();
    let track = Track::of_run(&run, "run");
    assert!(track.path.len() > 100, "{}", track.path.len());
    let scene = Scene { title: "cut".to_owned(), tracks: vec![track], ..Scene::default() };
    assert!(plot::svg(&scene).unwrap().contains("<circle"));
    assert!(plot::html(&scene).contains("the file was cut after"));
}

/// What a page's body holds after its script has run, opened at an address's end such as `#t=3`;
/// `None` without a browser.
fn browse(page: &Path, hash: &str, extra: &[&str]) -> Option<String> {
    browser::browse(&format!("file://{}{hash}", page.display()), extra)
}

/// The value of an attribute in a page's text.
fn attribute<'a>(dom: &'a str, name: &str) -> &'a str {
    let start =
        dom.find(&format!(" {name}=\"")).unwrap_or_else(|| panic!("no {name}")) + name.len() + 3;
    dom[start..].split('"').next().unwrap()
}

#[test]
fn a_browser_draws_the_page_and_its_slider_moves_through_time() {
    let scene = one();
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("map.html");
    let html = plot::html(&scene);
    keep("one.html", html.as_bytes());
    keep("several.html", plot::html(&several()).as_bytes());
    std::fs::write(&page, &html).unwrap();
    for (hash, until_s) in [("#t=10", 10.0), ("#t=0", 0.0), ("", 1e9)] {
        let Some(dom) = browse(&page, hash, &["--dump-dom"]) else { return };
        let points =
            scene.tracks[0].points.iter().filter(|point| seconds(point.time_ns) <= until_s).count();
        assert_eq!(attribute(&dom, "data-points"), points.to_string(), "at {hash}");
        let cloud = dom.split("class=\"points\"").nth(1).unwrap();
        assert_eq!(attribute(cloud, "d").matches("h0").count(), points, "at {hash}");
        let last = scene.tracks[0].path.iter().rfind(|p| seconds(p.time_ns) <= until_s).unwrap();
        let x: f64 = attribute(&dom, "data-x").parse().unwrap();
        assert!((x - last.x_m).abs() < 2e-3, "{x} is drawn at {hash}, {} was recorded", last.x_m);
        assert!(dom.contains("mapper: map &lt;the room&gt; &amp; back</h1>"));
    }
}

#[test]
fn a_browser_draws_the_floors_marks_its_edge_blocks_and_the_true_path() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("map.html");
    let mut scene = on_a_table();
    scene.blocks = vec![vec![[0.1, 0.1], [0.3, 0.1], [0.3, 0.3]]];
    let html = plot::html(&scene);
    keep("floor.html", html.as_bytes());
    std::fs::write(&page, &html).unwrap();
    let Some(dom) = browse(&page, "#t=10", &["--dump-dom"]) else { return };
    let marks: Vec<&str> = dom.split("<path class=\"floor\"").skip(1).collect();
    let [patch, line] = marks.as_slice() else { panic!("{} marks", marks.len()) };
    assert!(attribute(patch, "style").starts_with("fill:#ff7f7f") || patch.contains("#ff8080"));
    assert!(
        attribute(patch, "d").ends_with('Z') && attribute(patch, "d").matches('L').count() == 2
    );
    assert!(attribute(line, "style").starts_with("stroke:"), "{line:.200}");
    assert!(attribute(line, "stroke-width").parse::<f64>().unwrap() > 1.0, "{line:.200}");
    let truth = dom.split("stroke-dasharray=\"5 5\" class=\"truth\"").nth(1).unwrap();
    assert!(attribute(truth, "d").matches('L').count() > 100, "{truth:.200}");
    assert!(dom.contains("true path</li>") && dom.contains("edge of the floor</li>"));
    for (class, corners) in [("edge", scene.edges[0].len()), ("block", 3)] {
        let shape = dom.split(&format!("class=\"{class}\"")).nth(1).unwrap();
        let drawn = attribute(shape, "d");
        assert!(drawn.ends_with('Z'), "{class}: {drawn}");
        assert_eq!(drawn.matches('L').count() + 1, corners, "{class}: {drawn}");
    }
    // Where neither is known, the legend does not promise it.
    std::fs::write(&page, plot::html(&one())).unwrap();
    let Some(dom) = browse(&page, "", &["--dump-dom"]) else { return };
    for word in ["true path</li>", "edge of the floor</li>", "class=\"floor\""] {
        assert!(!dom.contains(word), "{word}");
    }
}

/// What a person's hands do: slide to 10 s, zoom in at (400, 300), drag by (40, −25).
const HANDS: &str = "<script>
slider.value = 10;
slider.dispatchEvent(new Event('input'));
const box = plot.getBoundingClientRect();
const under = () => [(400 - box.left - view.x) / view.scale, (300 - box.top - view.y) / view.scale];
const [scale, place] = [view.scale, under()];
plot.dispatchEvent(
    new WheelEvent('wheel', { deltaY: -500, clientX: 400, clientY: 300, cancelable: true }));
plot.dataset.zoomed = (view.scale / scale).toFixed(4);
plot.dataset.stayed = Math.hypot(under()[0] - place[0], under()[1] - place[1]).toFixed(6);
const [x, y] = [view.x, view.y];
const pointer = (name, clientX, clientY) =>
    plot.dispatchEvent(new PointerEvent(name, { pointerId: 1, clientX, clientY }));
pointer('pointerdown', 300, 300);
pointer('pointermove', 340, 275);
pointer('pointerup', 340, 275);
pointer('pointermove', 500, 500);
plot.dataset.dragged = `${(view.x - x).toFixed(1)} ${(view.y - y).toFixed(1)}`;
</script></body>";

#[test]
fn a_hand_slides_zooms_and_drags_the_page() {
    let scene = one();
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("map.html");
    std::fs::write(&page, plot::html(&scene).replace("</body>", HANDS)).unwrap();
    let Some(dom) = browse(&page, "", &["--dump-dom"]) else { return };
    let points =
        scene.tracks[0].points.iter().filter(|point| point.time_ns <= 10 * SECOND_NS).count();
    assert_eq!(attribute(&dom, "data-points"), points.to_string());
    assert_eq!(attribute(&dom, "data-time"), "10.000");
    assert_eq!(attribute(&dom, "data-zoomed"), "2.1170", "e to the 0.75");
    assert_eq!(attribute(&dom, "data-stayed"), "0.000000", "the place under the mouse stays");
    assert_eq!(attribute(&dom, "data-dragged"), "40.0 -25.0");
}

#[test]
fn tables_have_a_row_for_each_point_and_each_tick() {
    let scene = one();
    let points = export::points_csv(&scene.tracks);
    let path = export::path_csv(&scene.tracks);
    assert_eq!(points.lines().count(), scene.tracks[0].points.len() + 1);
    assert_eq!(path.lines().count(), 1_501);
    assert_eq!(points.lines().next(), Some("time_s,x_m,y_m,robot"));
    let row: Vec<&str> = path.lines().nth(101).unwrap().split(',').collect();
    let pose = tick(100).estimate.pose;
    assert_eq!(row[0], "2.000000");
    assert!((row[1].parse::<f64>().unwrap() - pose.x_m).abs() < 1e-6, "{row:?}");
    assert!(
        (row[3].parse::<f64>().unwrap() - pose.heading_rad.to_degrees()).abs() < 1e-4,
        "{row:?}"
    );
    assert_eq!(row[4], "mapper");
    let ply = export::ply(&scene.tracks);
    assert!(ply.starts_with("ply\nformat ascii 1.0\n"));
    let (head, body) = ply.split_once("end_header\n").unwrap();
    assert!(head.contains(&format!("element vertex {}\n", scene.tracks[0].points.len())), "{head}");
    assert_eq!(body.lines().count(), scene.tracks[0].points.len());
}

#[test]
fn a_grid_is_a_picture_with_the_highest_row_first() {
    let grid = grid();
    let pgm = export::pgm(&grid);
    assert_eq!(
        pgm,
        [b"P5\n# onbrick\n3 2\n255\n".as_slice(), &[205, 254, 205, 205, 254, 0]].concat()
    );
    let yaml = export::nav2_yaml(&grid, "map.pgm");
    let expected = "# onbrick\nimage: \"map.pgm\"\nmode: trinary\nresolution: 0.05\n\
                    origin: [-1.0, -0.5, 0.0]\nnegate: 0\noccupied_thresh: 0.65\n\
                    free_thresh: 0.196\n";
    assert_eq!(yaml, expected);
    let empty = Grid { resolution_m: 0.05, ..Grid::default() };
    assert_eq!(export::pgm(&empty), b"P5\n# onbrick\n0 0\n255\n");
}

fn part<'a>(name: &'a str, bytes: &'a [u8], shift_ns: i64) -> NamedRecording<'a> {
    NamedRecording { name, bytes, shift_ns }
}

#[test]
fn viewers_get_an_index_and_everything_that_was_recorded() {
    let bytes = sample(300, 1_000_000_000);
    let exported = export::mcap(&[part("mapper", &bytes, 0)]).unwrap();
    let summary = mcap::Summary::read(&exported).unwrap().unwrap();
    let whole = Run::read(&bytes).unwrap();
    let count = summary.stats.unwrap().message_count;
    assert_eq!(count, whole.integrity.messages);
    assert!(!summary.chunk_indexes.is_empty());
    let Some(found) = python(&exported, "indexed") else { return };
    assert_eq!(found["counted"], count);
    let counted: u64 =
        found["topics"].as_object().unwrap().values().map(|t| t["count"].as_u64().unwrap()).sum();
    assert_eq!(counted, count, "every message is decoded by its own definition");
    assert_eq!(found["attachments"]["mission.toml"], "name = \"map\"\n# ü\n");
    assert_eq!(found["metadata"]["onbrick"]["brick"], "mapper");
    assert_eq!(found["metadata"]["onbrick.end"]["word"], "finished");
}

#[test]
fn several_runs_get_a_namespace_each_in_one_tree_of_frames() {
    let (first, second) = (sample(100, 1_000_000_000), sample(60, 1_000_000_000));
    let cut = &second[..second.len() - 2_000];
    let exported =
        export::mcap(&[part("Ada", &first, 0), part("Grace", cut, 7_000_000_000)]).unwrap();
    let refused = Run::read(&exported).unwrap_err().to_string();
    assert!(refused.contains("several together"), "{refused}");
    let Some(found) = python(&exported, "indexed") else { return };
    let topics = &found["topics"];
    assert_eq!(topics["/ada/senses"]["count"], 100);
    assert_eq!(
        topics["/grace/senses"]["count"].as_u64().unwrap(),
        Run::read(cut).unwrap().senses.len() as u64
    );
    assert_eq!(topics["/ada/odom"]["first"]["header"]["frame_id"], "ada/odom");
    assert_eq!(topics["/grace/range"]["first"]["header"]["frame_id"], "grace/range_link");
    assert_eq!(topics["/ada/points"]["first"]["header"]["frame_id"], "map");
    // The second brick's clock was seven seconds behind: its stamps and its offset are moved, what
    // its run's clock says is not.
    let stamp = |topic: &str| topics[topic]["first"]["header"]["stamp"]["sec"].as_i64().unwrap();
    assert_eq!(stamp("/grace/odom") - stamp("/ada/odom"), 7);
    assert_eq!(
        topics["/grace/senses"]["first"]["time_ns"],
        topics["/ada/senses"]["first"]["time_ns"]
    );
    let offset = |brick: &str| {
        found["metadata"][format!("{brick}/onbrick")]["wall_offset_ns"]
            .as_str()
            .unwrap()
            .parse::<i64>()
            .unwrap()
    };
    assert_eq!(offset("grace") - offset("ada"), 7_000_000_000);
    let still = &topics["/tf_static"];
    assert_eq!(still["count"], 2);
    assert_eq!(still["last"]["transforms"][0]["header"]["frame_id"], "map");
    assert_eq!(still["last"]["transforms"][0]["child_frame_id"], "grace/odom");
    assert_eq!(found["attachments"]["grace/robot.toml"], "name = \"mapper\"\n");
    let error = export::mcap(&[part("nothing", b"text", 0)]).unwrap_err();
    assert_eq!(error.to_string(), "cannot export nothing");
}
