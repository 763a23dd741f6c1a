//! Other people's readers open the file as it comes from the brick.

use std::collections::BTreeMap;
use std::process::Command;

use onbrick::recording::Run;
use onbrick::recording::message::{OccupancyGridMessage, decode};
use onbrick::sim::World;
use serde_json::Value;

use super::decoder::{python, read_by};
use super::sample::sample;
use crate::missions::{job, play, robot};

/// A run of the mission that maps, long enough for a map that is written while it grows.
fn mapped() -> &'static [u8] {
    static MAPPED: std::sync::OnceLock<Vec<u8>> = std::sync::OnceLock::new();
    MAPPED.get_or_init(|| {
        let world = World::text("arena").unwrap();
        let played = play(|file| {
            let mut job = job("map", &robot(), ("arena", world), 5, file);
            job.set.push(("time_limit_s".to_owned(), 12.0));
            job
        });
        played.bytes
    })
}

/// How many messages each topic has, counted one by one in the order of the file.
fn counted(bytes: &[u8]) -> BTreeMap<String, u64> {
    let mut topics = BTreeMap::new();
    for message in mcap::MessageStream::new(bytes).unwrap() {
        *topics.entry(message.unwrap().channel.topic.clone()).or_default() += 1;
    }
    topics
}

#[track_caller]
fn assert_all_are_there(found: &Value, bytes: &[u8]) {
    let topics: BTreeMap<String, u64> = serde_json::from_value(found["topics"].clone()).unwrap();
    assert_eq!(topics, counted(bytes), "{found}");
    assert!(topics["/map"] > 1 && topics["/odom"] > 100, "{topics:?}");
}

#[test]
fn the_summary_and_the_indexes_lead_to_every_message() {
    for bytes in [mapped(), &sample(700, 1_000_000_000), &sample(700, 100_000_000)] {
        let summary = mcap::Summary::read(bytes).unwrap().expect("a summary");
        let statistics = summary.stats.clone().unwrap();
        let all: u64 = counted(bytes).values().sum();
        assert_eq!(statistics.message_count, all);
        assert_eq!(statistics.chunk_count as usize, summary.chunk_indexes.len());
        assert!(summary.chunk_indexes.len() >= 12, "{} chunks", summary.chunk_indexes.len());
        let mut found = 0;
        for chunk in &summary.chunk_indexes {
            let streamed = summary.stream_chunk(bytes, chunk).unwrap().map(Result::unwrap).count();
            let indexes = summary.read_message_indexes(bytes, chunk).unwrap();
            let entries = indexes.values().flatten();
            for entry in entries.clone() {
                let message = summary.seek_message(bytes, chunk, entry).unwrap();
                assert_eq!(message.log_time, entry.log_time);
                let times = chunk.message_start_time..=chunk.message_end_time;
                assert!(times.contains(&message.log_time), "{} not in {times:?}", message.log_time);
            }
            assert_eq!(streamed, entries.count());
            found += streamed as u64;
        }
        assert_eq!(found, all);
        let names: Vec<_> = summary
            .attachment_indexes
            .iter()
            .map(|index| mcap::read::attachment(bytes, index).unwrap().name)
            .collect();
        assert_eq!(names, ["robot.toml", "mission.toml", "world.toml"]);
        let names: Vec<_> = summary
            .metadata_indexes
            .iter()
            .map(|index| mcap::read::metadata(bytes, index).unwrap().name)
            .collect();
        assert_eq!(names, ["onbrick", "onbrick.end"]);
    }
}

#[test]
fn pypi_mcap_seeks_by_the_index() {
    let Some(found) = by_python("mcap", "mcap") else { return };
    assert_all_are_there(&found, mapped());
    assert_eq!((&found["unordered"], &found["backwards"]), (&0.into(), &true.into()));
    assert_eq!(found["before_the_middle"], 0);
    let (late, all) = (found["late"].as_u64().unwrap(), counted(mapped())["/pose"]);
    assert!(late.abs_diff(all / 2) <= 1, "{late} of {all} in the second half");
}

#[test]
fn mcap_ros2_support_decodes_through_the_index() {
    let Some(found) = python(mapped(), "indexed") else { return };
    let decoded: BTreeMap<String, u64> = found["topics"]
        .as_object()
        .unwrap()
        .iter()
        .map(|(topic, found)| (topic.clone(), found["count"].as_u64().unwrap()))
        .collect();
    assert_eq!(decoded, counted(mapped()));
    let ending = Run::read(mapped()).unwrap().ending.unwrap();
    assert_eq!(found["metadata"]["onbrick.end"]["word"], ending.stop.reason.word());
    // Nav2 takes 100, and nothing less, for an obstacle; and −1 for unknown.
    assert_eq!(found["topics"]["/map"]["schema"], "nav_msgs/msg/OccupancyGrid");
    let messages = mcap::MessageStream::new(mapped()).unwrap().map(Result::unwrap);
    for map in messages.filter(|message| message.channel.topic == "/map") {
        let grid: OccupancyGridMessage = decode(&map.data).unwrap();
        assert!(grid.data.iter().all(|cell| (-1..=100).contains(cell)));
        let [occupied, free, unknown] =
            [100, 0, -1].map(|wanted| grid.data.iter().filter(|cell| **cell == wanted).count());
        assert!(occupied > 0 && unknown > 0, "{occupied} {free} {unknown}");
        let cells = u32::try_from(grid.data.len()).unwrap();
        assert_eq!(grid.width * grid.height, cells);
    }
}

#[test]
fn rosbags_reads_every_message_by_its_definition() {
    let Some(found) = by_python("rosbags", "rosbags") else { return };
    assert_all_are_there(&found, mapped());
    assert_eq!(found["unordered"], 0);
    assert_eq!(found["types"]["/map"], "nav_msgs/msg/OccupancyGrid");
}

#[test]
fn rerun_has_a_row_for_every_message_and_shows_those_of_ros() {
    let Some(found) = by_python("rerun", "rerun.chunk") else { return };
    assert_all_are_there(&found, mapped());
    let counted = counted(mapped());
    let shown = |what: &str| {
        found["shown"][what].as_u64().unwrap_or_else(|| panic!("no {what}: {found:#}"))
    };
    assert_eq!(shown("/map GridMap:data"), counted["/map"]);
    assert_eq!(shown("/points Points3D:positions"), counted["/points"]);
    assert_eq!(shown("/tf Transform3D:translation"), 2 * counted["/tf"], "two frames move");
    assert_eq!(shown("/odom nav_msgs.msg.Odometry:message"), counted["/odom"]);
}

#[test]
fn foxgloves_reader_goes_through_it_in_the_order_of_log_time() {
    let packages = Command::new("npm").args(["root", "--global"]).output();
    let packages = packages.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    let command = || {
        let mut node = Command::new("node");
        node.env("NODE_PATH", packages.as_deref().unwrap_or_default());
        node
    };
    let Some(found) = read_by(
        &command,
        &["-e", "require('@mcap/core')"],
        "node with the package @mcap/core",
        "tests/node/log_time_order.cjs",
        mapped(),
        "",
    ) else {
        return;
    };
    assert_all_are_there(&found, mapped());
    assert_eq!(found["unordered"], 0);
    assert_eq!(
        found["attachments"],
        serde_json::json!(["robot.toml", "mission.toml", "world.toml"])
    );
    assert_eq!(found["metadata"], serde_json::json!(["onbrick", "onbrick.end"]));
}

fn by_python(reader: &str, package: &str) -> Option<Value> {
    let command = || Command::new("python3");
    let probe = format!("import {package}");
    let what = format!("python3 with the package of {reader}");
    read_by(&command, &["-c", &probe], &what, "tests/python/readers.py", mapped(), reader)
}
