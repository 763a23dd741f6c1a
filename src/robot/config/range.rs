//! `[range]` of `robot.toml`: how the range sensor sits and measures.

use crate::document::{Item, Section};
use crate::mapping::{OwnEcho, OwnEchoes, RangeMount};
use crate::units::{degrees, radians};

/// How the range sensor sits and measures.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeRole {
    /// Metres from the middle of the axle to the sensor, ahead.
    pub ahead_m: f64,
    /// Readings from here on make no point of the map, metres.
    pub max_m: f64,
    /// Half of the cone that it hears in, radians.
    pub half_cone_rad: f64,
    /// What its readings are too large by, metres.
    pub bias_m: f64,
    /// What it says for each metre more, metres.
    pub scale: f64,
    /// Where it hears the robot itself.
    pub own_echoes: OwnEchoes,
    /// Metres for one percent of the infrared sensor's proximity: LEGO says 100 % is about 0.7 m.
    pub infrared_m_per_pct: f64,
}

pub(super) fn range(section: &Section<'_>) -> Option<RangeRole> {
    section.allow(&[
        "port",
        "driver",
        "ahead_m",
        "max_m",
        "half_cone_deg",
        "bias_m",
        "scale",
        "own_echoes",
        "infrared_m_per_pct",
    ]);
    let usual = RangeMount::default();
    let ahead_m = section.value_or("ahead_m", 0.0, |item| item.number(RangeMount::AHEAD_M));
    // The sensor's own end.
    let max_m =
        section.value_or("max_m", 2.0, |item| item.number(*RangeMount::MAX_M.start()..=2.55));
    let infrared = section.value_or("infrared_m_per_pct", 0.007, |item| item.number(0.0001..=0.1));
    let (least_rad, most_rad) = RangeMount::HALF_CONE_RAD.into_inner();
    let half_cone_rad = section.value_or("half_cone_deg", usual.half_cone_rad, |item| {
        item.number(degrees(least_rad)..=libm::floor(degrees(most_rad))).map(radians)
    });
    let bias_m = section.value_or("bias_m", usual.bias_m, |item| item.number(RangeMount::BIAS_M));
    let scale = section.value_or("scale", usual.scale, |item| item.number(RangeMount::SCALE));
    let own_echoes = section.value_or("own_echoes", OwnEchoes::default(), own_echoes);
    Some(RangeRole {
        ahead_m: ahead_m?,
        max_m: max_m?,
        half_cone_rad: half_cone_rad?,
        bias_m: bias_m?,
        scale: scale?,
        own_echoes: own_echoes?,
        infrared_m_per_pct: infrared?,
    })
}

/// Angles of the head from and to, degrees, and what the sensor says there, metres.
fn own_echoes(item: &Item<'_>) -> Option<OwnEchoes> {
    let list = item.list()?;
    if list.len() > OwnEchoes::MAX {
        item.error(format!(
            "`{}` has {} places; it takes {}",
            item.path(),
            list.len(),
            OwnEchoes::MAX
        ))
        .hint("places side by side can be one, from the first to the last");
        return None;
    }
    let own = |item: &Item<'_>| {
        let [from_deg, to_deg, range_m] = item.numbers::<3>(-360.0..=360.0)?;
        if !OwnEchoes::RANGE_M.contains(&range_m) {
            let (least, most) = OwnEchoes::RANGE_M.into_inner();
            item.error(format!("a part of the robot is {least} to {most} m off, not {range_m}"))
                .hint("from and to, degrees of the head, then metres: [80, 100, 0.2]");
            return None;
        }
        Some(OwnEcho { from_rad: radians(from_deg), to_rad: radians(to_deg), range_m })
    };
    list.iter().map(own).collect::<Option<Vec<_>>>().map(OwnEchoes::of)
}
