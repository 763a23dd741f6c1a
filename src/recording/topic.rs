//! The table of topics: what a recording's channels are called and what flows in them.
//!
//! The definitions of the messages stand beside this file (`schema/`), one file a type, in ROS 2's
//! own language. A channel's schema is its message's definition followed by those of all types
//! inside it, as the format `ros2msg` of MCAP wants it.

use std::collections::BTreeMap;

/// What the header of a file says that wrote it: one version has one table of topics, so a reader
/// that finds its own version knows the channels even where their description is lost.
pub(super) const LIBRARY: &str = concat!("onbrick ", env!("CARGO_PKG_VERSION"));

/// The frame that maps and poses are given in.
pub const FRAME_MAP: &str = "map";
/// The frame that odometry starts from.
pub const FRAME_ODOM: &str = "odom";
/// The robot: between the wheels, on the floor.
pub const FRAME_BASE: &str = "base_link";
/// The range sensor: where distances are counted from, x in the direction of measuring.
pub const FRAME_RANGE: &str = "range_link";

/// A row for each topic, by channel number: its name and its message's type, `package/Name`.
macro_rules! topics {
    ($($topic:ident = $name:literal, $message:literal;)+) => {
        /// A channel of a recording. Its place in [`Topic::ALL`] is its channel number, so the
        /// order never changes; new topics go to the end.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u16)]
        #[non_exhaustive]
        pub enum Topic {
            $(#[doc = concat!("`", $name, "`.")] $topic),+
        }

        const TOPICS: &[(&str, &str)] = &[$(($name, $message)),+];

        impl Topic {
            /// Every topic, by channel number.
            pub const ALL: [Self; TOPICS.len()] = [$(Self::$topic),+];
        }
    };
}

topics! {
    Senses = "/senses", "onbrick_msgs/Senses";
    Pose = "/pose", "onbrick_msgs/Pose";
    Odometry = "/odom", "nav_msgs/Odometry";
    Transforms = "/tf", "tf2_msgs/TFMessage";
    StaticTransforms = "/tf_static", "tf2_msgs/TFMessage";
    Range = "/range", "sensor_msgs/Range";
    Points = "/points", "sensor_msgs/PointCloud2";
    Map = "/map", "nav_msgs/OccupancyGrid";
    Transitions = "/transitions", "onbrick_msgs/Transition";
    Log = "/rosout", "rcl_interfaces/Log";
    Statistics = "/stats", "onbrick_msgs/TickStatistics";
    Checkpoint = "/checkpoint", "onbrick_msgs/Checkpoint";
    Gap = "/gap", "onbrick_msgs/Gap";
    Variables = "/variables", "onbrick_msgs/Variables";
    Truth = "/truth", "geometry_msgs/PoseStamped";
    Walls = "/walls", "visualization_msgs/Marker";
    Keyframes = "/keyframes", "onbrick_msgs/Keyframes";
}

impl Topic {
    /// The topic's name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        TOPICS[self as usize].0
    }

    const fn message_type(self) -> &'static str {
        TOPICS[self as usize].1
    }

    /// The full name of the message's type, such as `sensor_msgs/msg/Range`.
    #[must_use]
    pub fn schema_name(self) -> String {
        self.message_type().replacen('/', "/msg/", 1)
    }

    /// The first topic with the same type of messages.
    fn first_of_its_schema(self) -> Self {
        Self::ALL
            .into_iter()
            .find(|other| other.message_type() == self.message_type())
            .unwrap_or(self)
    }

    /// True for one topic of each type of messages.
    pub(super) fn names_its_schema(self) -> bool {
        self.first_of_its_schema() == self
    }

    /// The number of its type in a file; MCAP keeps 0 for none.
    #[must_use]
    pub fn schema_id(self) -> u16 {
        self.first_of_its_schema() as u16 + 1
    }

    /// The definition of the message's type and of all types inside it.
    #[must_use]
    pub fn schema(self) -> String {
        let mut todo = vec![self.message_type()];
        let mut done = Vec::new();
        let mut text = String::new();
        while let Some(name) = todo.pop() {
            if done.contains(&name) {
                continue;
            }
            let Some((_, definition)) = DEFINITIONS.iter().find(|(known, _)| *known == name) else {
                continue;
            };
            if !done.is_empty() {
                text.push_str(&format!("{}\nMSG: {name}\n", "=".repeat(80)));
            }
            text.push_str(definition);
            done.push(name);
            todo.extend(types_inside(definition));
        }
        text
    }

    /// What else is said about the channel: `rosbag2` plays `/tf_static`, `/map` and `/walls`
    /// to late listeners only if asked to.
    #[must_use]
    pub fn channel_metadata(self) -> BTreeMap<String, String> {
        let mut metadata = BTreeMap::new();
        if matches!(self, Self::StaticTransforms | Self::Map | Self::Walls) {
            metadata.insert("offered_qos_profiles".to_owned(), LATCHED.to_owned());
        }
        metadata
    }

    /// The topic of a channel as a file describes it: name and type must both be known.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
    }
}

/// The types with a package that a definition's fields have.
fn types_inside(definition: &'static str) -> impl Iterator<Item = &'static str> {
    definition.lines().filter_map(|line| {
        let name = line.split_whitespace().next()?;
        let name = name.split('[').next()?;
        (!name.starts_with('#') && name.contains('/')).then_some(name)
    })
}

const LATCHED: &str = "\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline:
    sec: 0
    nsec: 0
  lifespan:
    sec: 0
    nsec: 0
  liveliness: 0
  liveliness_lease_duration:
    sec: 0
    nsec: 0
  avoid_ros_namespace_conventions: false
";

macro_rules! definitions {
    ($($package:literal / $name:literal),+ $(,)?) => {
        /// Every message type that a recording speaks, with its definition.
        const DEFINITIONS: &[(&str, &str)] = &[$((
            concat!($package, "/", $name),
            include_str!(concat!("schema/", $package, ".", $name, ".msg")),
        )),+];
    };
}

definitions! {
    "builtin_interfaces" / "Time",
    "builtin_interfaces" / "Duration",
    "std_msgs" / "Header",
    "std_msgs" / "ColorRGBA",
    "geometry_msgs" / "Point",
    "geometry_msgs" / "Vector3",
    "geometry_msgs" / "Quaternion",
    "geometry_msgs" / "Pose",
    "geometry_msgs" / "PoseStamped",
    "geometry_msgs" / "PoseWithCovariance",
    "geometry_msgs" / "Twist",
    "geometry_msgs" / "TwistWithCovariance",
    "geometry_msgs" / "Transform",
    "geometry_msgs" / "TransformStamped",
    "nav_msgs" / "Odometry",
    "nav_msgs" / "MapMetaData",
    "nav_msgs" / "OccupancyGrid",
    "tf2_msgs" / "TFMessage",
    "sensor_msgs" / "Range",
    "sensor_msgs" / "PointField",
    "sensor_msgs" / "PointCloud2",
    "sensor_msgs" / "CompressedImage",
    "visualization_msgs" / "Marker",
    "visualization_msgs" / "MeshFile",
    "visualization_msgs" / "UVCoordinate",
    "rcl_interfaces" / "Log",
    "onbrick_msgs" / "Keyframe",
    "onbrick_msgs" / "Keyframes",
    "onbrick_msgs" / "Senses",
    "onbrick_msgs" / "Pose",
    "onbrick_msgs" / "Transition",
    "onbrick_msgs" / "TickStatistics",
    "onbrick_msgs" / "Checkpoint",
    "onbrick_msgs" / "Gap",
    "onbrick_msgs" / "Variables",
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_topic_stands_at_its_channel_number_and_is_found_by_name() {
        for (place, topic) in Topic::ALL.into_iter().enumerate() {
            assert_eq!(topic as usize, place, "{topic:?}");
            assert_eq!(Topic::of_name(topic.name()), Some(topic));
        }
    }

    #[test]
    fn a_schema_defines_each_type_inside_once() {
        for topic in Topic::ALL {
            let schema = topic.schema();
            assert!(!schema.is_empty(), "{topic:?}");
            for (name, _) in DEFINITIONS {
                let title = format!("MSG: {name}\n");
                assert!(schema.matches(&title).count() <= 1, "{topic:?} has {name} twice");
            }
        }
        for name in DEFINITIONS.iter().flat_map(|(_, definition)| types_inside(definition)) {
            assert!(DEFINITIONS.iter().any(|(known, _)| *known == name), "{name} is not defined");
        }
        assert!(Topic::Odometry.schema().contains("MSG: geometry_msgs/Quaternion\n"));
    }
}
