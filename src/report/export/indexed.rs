//! Recordings as one MCAP file in chunks with an index, in order of time, as viewers open fastest.
//!
//! One run keeps its topics and frames. Several get a namespace each: topics `/NAME/odom`, frames `NAME/base_link`; the frame
//! `map` stays common, because all poses are given in it.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions, Writer};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::runtime::recording::message::{
    Header, OccupancyGridMessage, Odometry, PointCloud2, RangeMessage, TfMessage, decode, encode,
};
use crate::runtime::recording::{FRAME_MAP, Found, ReadError, Run, Topic, walk};

/// An export failed.
#[derive(Debug, thiserror::Error)]
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

/// Recordings, each with its robot's name, as one file. A damaged or cut recording gives what is whole of it.
///
/// # Errors
///
/// See [`ExportError`].
pub fn mcap(runs: &[(&str, &[u8])]) -> Result<Vec<u8>, ExportError> {
    let spaces = namespaces(runs);
    let mut messages = Vec::new();
    let mut writer = WriteOptions::new()
        .profile("ros2")
        .library(concat!("onbrick ", env!("CARGO_PKG_VERSION")))
        .create(Cursor::new(Vec::new()))?;
    for ((name, bytes), space) in runs.iter().zip(&spaces) {
        Run::read(bytes).map_err(|source| ExportError::Read { name: (*name).to_owned(), source })?;
        let mut outcome = Ok(());
        walk(bytes, true, &mut |_, found| {
            if outcome.is_ok() {
                outcome = take(found, space, &mut messages, &mut writer);
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
fn write(writer: &mut Writer<Cursor<Vec<u8>>>, messages: &[MessageRecord<'_>]) -> Result<(), McapError> {
    let mut channels = BTreeMap::new();
    for message in messages {
        let MessageRecord { sequence, log_time, space, topic, data } = *message;
        let channel_id = match channels.get(&(space, topic)) {
            Some(channel) => *channel,
            None => {
                let channel = describe(writer, space, topic)?;
                channels.insert((space, topic), channel);
                channel
            }
        };
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &in_space(space, topic, data))?;
    }
    Ok(())
}

/// A message before it is written again.
struct MessageRecord<'a> {
    log_time: u64,
    sequence: u32,
    space: &'a str,
    topic: Topic,
    data: &'a [u8],
}

fn take<'a>(
    found: Found<'a>,
    space: &'a str,
    messages: &mut Vec<MessageRecord<'a>>,
    writer: &mut Writer<Cursor<Vec<u8>>>,
) -> Result<(), McapError> {
    let named = |name: &str| if space.is_empty() { name.to_owned() } else { format!("{space}/{name}") };
    match found {
        Found::Message { topic: Some(topic), header, data } => {
            let (log_time, sequence) = (header.log_time, header.sequence);
            messages.push(MessageRecord { log_time, sequence, space, topic, data });
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
            writer.write_metadata(&Metadata { name: named(&metadata.name), metadata: metadata.metadata })
        }
    }
}

fn describe(writer: &mut Writer<Cursor<Vec<u8>>>, space: &str, topic: Topic) -> Result<u16, McapError> {
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

/// A namespace for each run: none for a single one; else its name in the letters that ROS allows, made different where two are
/// the same.
fn namespaces(runs: &[(&str, &[u8])]) -> Vec<String> {
    if runs.len() == 1 {
        return vec![String::new()];
    }
    let mut spaces: Vec<String> = Vec::new();
    for (name, _) in runs {
        let allowed = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
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

/// A message with its frames in the namespace.
fn in_space(space: &str, topic: Topic, data: &[u8]) -> Vec<u8> {
    if space.is_empty() {
        return data.to_vec();
    }
    let changed = match topic {
        Topic::Odometry => change::<Odometry>(data, |odometry| {
            frame(space, &mut odometry.header);
            name(space, &mut odometry.child_frame_id);
        }),
        Topic::Transforms | Topic::StaticTransforms => change::<TfMessage>(data, |message| {
            for transform in &mut message.transforms {
                frame(space, &mut transform.header);
                name(space, &mut transform.child_frame_id);
            }
        }),
        Topic::Range => change::<RangeMessage>(data, |range| frame(space, &mut range.header)),
        Topic::Points => change::<PointCloud2>(data, |cloud| frame(space, &mut cloud.header)),
        Topic::Map => change::<OccupancyGridMessage>(data, |map| frame(space, &mut map.header)),
        _ => None,
    };
    changed.unwrap_or_else(|| data.to_vec())
}

fn change<T: Serialize + DeserializeOwned>(data: &[u8], with: impl FnOnce(&mut T)) -> Option<Vec<u8>> {
    let mut message: T = decode(data)?;
    with(&mut message);
    encode(&message).ok()
}

fn frame(space: &str, header: &mut Header) {
    name(space, &mut header.frame_id);
}

fn name(space: &str, frame: &mut String) {
    if frame != FRAME_MAP {
        *frame = format!("{space}/{frame}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn namespaces_are_names_that_ros_allows_and_differ() {
        let runs: Vec<(&str, &[u8])> = vec![("Ada", &[]), ("ada", &[]), ("3 é", &[]), ("", &[])];
        assert_eq!(namespaces(&runs), ["ada", "ada_2", "robot_3__", "robot_"]);
        assert_eq!(namespaces(&runs[..1]), [""]);
    }
}
