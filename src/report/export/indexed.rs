//! Recordings as one whole MCAP file, in the order of time: what is whole of a cut one, or several
//! together.
//!
//! One run keeps its topics and frames. Several get a namespace each: topics `/NAME/odom`, frames
//! `NAME/base_link`; the frame `map` stays common, because all poses are given in it.
//!
//! Each brick stamps by its own calendar, which may be years off. A part's shift puts its log
//! times, its messages' stamps and the `wall_offset_ns` of its metadata onto the clock that all
//! share; times of the run's own clock (`time_ns`) stay what they are.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions, Writer};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::recording::message::{
    Header, LogMessage, OccupancyGridMessage, Odometry, PointCloud2, PoseStamped, RangeMessage,
    TfMessage, decode, encode,
};
use crate::recording::walls::Marker;
use crate::recording::{FRAME_MAP, Found, ReadError, Run, Topic, sealed, walk};

/// A recording that becomes a part of the file.
#[derive(Debug, Clone, Copy)]
pub struct NamedRecording<'a> {
    /// The robot's name.
    pub name: &'a str,
    /// The recording.
    pub bytes: &'a [u8],
    /// What its stamps are moved by, nanoseconds.
    pub shift_ns: i64,
}

/// An export failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// A file is no recording.
    #[error("cannot export {name}")]
    Read {
        /// The run.
        name: String,
        /// What is wrong with it.
        source: ReadError,
    },
    /// The new file cannot be written.
    #[error("cannot write the MCAP file")]
    Write(#[from] McapError),
}

/// Recordings as one file. A damaged or cut recording gives what is whole of it.
///
/// # Errors
///
/// See [`ExportError`].
pub fn mcap(parts: &[NamedRecording<'_>]) -> Result<Vec<u8>, ExportError> {
    let names: Vec<&str> = parts.iter().map(|part| part.name).collect();
    let spaces = namespaces(&names);
    let mut messages = Vec::new();
    let mut writer = WriteOptions::new()
        .profile("ros2")
        .library(concat!("onbrick ", env!("CARGO_PKG_VERSION"), ", rewritten"))
        .create(Cursor::new(Vec::new()))?;
    for (part, space) in parts.iter().zip(&spaces) {
        Run::read(part.bytes)
            .map_err(|source| ExportError::Read { name: part.name.to_owned(), source })?;
        let place = Destination { space, shift_ns: part.shift_ns };
        let mut outcome = Ok(());
        walk(part.bytes, &mut |found| {
            if outcome.is_ok() {
                outcome = take(found, place, &mut messages, &mut writer);
            }
        });
        outcome?;
    }
    messages.sort_by_key(|message| message.log_time);
    write(&mut writer, &messages)?;
    writer.finish()?;
    Ok(writer.into_inner().into_inner())
}

/// Writes the messages, each on its namespace's channel.
fn write(
    writer: &mut Writer<Cursor<Vec<u8>>>,
    messages: &[MessageRecord<'_>],
) -> Result<(), McapError> {
    let mut channels = BTreeMap::new();
    for message in messages {
        let MessageRecord { sequence, log_time, place, topic, data } = *message;
        let channel_id = match channels.get(&(place.space, topic)) {
            Some(channel) => *channel,
            None => {
                let channel = describe(writer, place.space, topic)?;
                channels.insert((place.space, topic), channel);
                channel
            }
        };
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &place.put(topic, data))?;
    }
    Ok(())
}

/// Where a recording goes: its namespace, and what its stamps are moved by.
#[derive(Debug, Clone, Copy)]
struct Destination<'a> {
    space: &'a str,
    shift_ns: i64,
}

/// A message before it is written again.
struct MessageRecord<'a> {
    log_time: u64,
    sequence: u32,
    place: Destination<'a>,
    topic: Topic,
    data: &'a [u8],
}

fn take<'a>(
    found: Found<'a>,
    place: Destination<'a>,
    messages: &mut Vec<MessageRecord<'a>>,
    writer: &mut Writer<Cursor<Vec<u8>>>,
) -> Result<(), McapError> {
    let Destination { space, shift_ns } = place;
    let named =
        |name: &str| if space.is_empty() { name.to_owned() } else { format!("{space}/{name}") };
    match found {
        Found::Message { topic: Some(topic), header, data } => {
            let (log_time, sequence) =
                (header.log_time.saturating_add_signed(shift_ns), header.sequence);
            messages.push(MessageRecord { log_time, sequence, place, topic, data });
            Ok(())
        }
        Found::Message { topic: None, .. } => Ok(()),
        Found::Attachment { name, media_type, data } => writer.attach(&mcap::Attachment {
            log_time: 0,
            create_time: 0,
            name: named(&name),
            media_type,
            data: data.into(),
        }),
        Found::Metadata(metadata) => {
            let mut values = metadata.metadata;
            if let Some(offset) = values.get_mut("wall_offset_ns")
                && let Ok(offset_ns) = offset.parse::<i64>()
            {
                *offset = offset_ns.saturating_add(shift_ns).to_string();
            }
            writer
                .write_metadata(&sealed(Metadata { name: named(&metadata.name), metadata: values }))
        }
    }
}

fn describe(
    writer: &mut Writer<Cursor<Vec<u8>>>,
    space: &str,
    topic: Topic,
) -> Result<u16, McapError> {
    let schema = writer.add_schema(&topic.schema_name(), "ros2msg", topic.schema().as_bytes())?;
    // Transforms of all robots make one tree, and viewers look for it under one name.
    let shared = matches!(topic, Topic::Transforms | Topic::StaticTransforms);
    let name = if space.is_empty() || shared {
        topic.name().to_owned()
    } else {
        format!("/{space}{}", topic.name())
    };
    writer.add_channel(schema, &name, "cdr", &topic.channel_metadata())
}

/// A namespace for each run: none for a single one; else its name in the letters that ROS allows,
/// made different where two are the same.
fn namespaces(names: &[&str]) -> Vec<String> {
    if names.len() == 1 {
        return vec![String::new()];
    }
    let mut spaces: Vec<String> = Vec::new();
    for name in names {
        let allowed =
            |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
        let mut plain: String = name.chars().map(allowed).collect();
        if !plain.starts_with(|c: char| c.is_ascii_alphabetic()) {
            plain.insert_str(0, "robot_");
        }
        let mut space = plain.clone();
        let mut number = 2;
        while spaces.contains(&space) {
            space = format!("{plain}_{number}");
            number += 1;
        }
        spaces.push(space);
    }
    spaces
}

impl Destination<'_> {
    /// A message with its frames in the namespace and its stamps on the common clock.
    fn put(self, topic: Topic, data: &[u8]) -> Vec<u8> {
        if self.space.is_empty() && self.shift_ns == 0 {
            return data.to_vec();
        }
        let changed = match topic {
            Topic::Odometry => change::<Odometry>(data, |odometry| {
                self.head(&mut odometry.header);
                self.frame(&mut odometry.child_frame_id);
            }),
            Topic::Transforms | Topic::StaticTransforms => change::<TfMessage>(data, |message| {
                for transform in &mut message.transforms {
                    self.head(&mut transform.header);
                    self.frame(&mut transform.child_frame_id);
                }
            }),
            Topic::Range => change::<RangeMessage>(data, |range| self.head(&mut range.header)),
            Topic::Points => change::<PointCloud2>(data, |cloud| self.head(&mut cloud.header)),
            Topic::Map => change::<OccupancyGridMessage>(data, |map| {
                self.head(&mut map.header);
                map.map_load_time = map.map_load_time.later(self.shift_ns);
            }),
            Topic::Walls => change::<Marker>(data, |walls| self.head(&mut walls.header)),
            Topic::Truth => change::<PoseStamped>(data, |truth| self.head(&mut truth.header)),
            Topic::Log => {
                change::<LogMessage>(data, |log| log.stamp = log.stamp.later(self.shift_ns))
            }
            _ => None,
        };
        changed.unwrap_or_else(|| data.to_vec())
    }

    fn head(self, header: &mut Header) {
        header.stamp = header.stamp.later(self.shift_ns);
        self.frame(&mut header.frame_id);
    }

    fn frame(self, frame: &mut String) {
        if frame != FRAME_MAP && !self.space.is_empty() {
            *frame = format!("{}/{frame}", self.space);
        }
    }
}

fn change<T: Serialize + DeserializeOwned>(
    data: &[u8],
    with: impl FnOnce(&mut T),
) -> Option<Vec<u8>> {
    let mut message: T = decode(data)?;
    with(&mut message);
    encode(&message).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn namespaces_are_names_that_ros_allows_and_differ() {
        let names = ["Ada", "ada", "3 é", ""];
        assert_eq!(namespaces(&names), ["ada", "ada_2", "robot_3__", "robot_"]);
        assert_eq!(namespaces(&names[..1]), [""]);
    }

    #[test]
    fn walls_are_put_on_the_common_clock() {
        // All fields of a marker are zero, and its texts and lists are empty.
        let zero = [&[0, 1, 0, 0][..], &[0; 400]].concat();
        let marker = encode(&decode::<Marker>(&zero).unwrap()).unwrap();
        let moved =
            Destination { space: "ada", shift_ns: 7_000_000_002 }.put(Topic::Walls, &marker);
        let header = decode::<Marker>(&moved).unwrap().header;
        assert_eq!((header.stamp.sec, header.stamp.nanosec), (7, 2));
    }
}
