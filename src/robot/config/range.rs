//! `[range]` of `robot.toml`: how the range sensor sits and measures.

use crate::document::{Item, Section};
use crate::mapping::{OwnEcho, OwnEchoes, RangeMount};
use crate::units::{degrees, radians};

/// LEGO says that 100 % is about 0.7 m.
pub(super) const INFRARED_M_PER_PCT: f64 = 0.007;

/// Where the sensor sits and what it can do, and the metres for one percent of the infrared one.
pub(super) fn range(section: &Section<'_>) -> Option<(RangeMount, f64)> {
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
    let infrared = section
        .value_or("infrared_m_per_pct", INFRARED_M_PER_PCT, |item| item.number(0.0001..=0.1));
    let (least_rad, most_rad) = RangeMount::HALF_CONE_RAD.into_inner();
    let half_cone_rad = section.value_or("half_cone_deg", usual.half_cone_rad, |item| {
        item.number(degrees(least_rad)..=libm::floor(degrees(most_rad))).map(radians)
    });
    let bias_m = section.value_or("bias_m", usual.bias_m, |item| item.number(RangeMount::BIAS_M));
    let scale = section.value_or("scale", usual.scale, |item| item.number(RangeMount::SCALE));
    let own_echoes = section.value_or("own_echoes", OwnEchoes::default(), own_echoes);
    let mount = RangeMount {
        ahead_m: ahead_m?,
        max_m: max_m?,
        half_cone_rad: half_cone_rad?,
        bias_m: bias_m?,
        scale: scale?,
        own_echoes: own_echoes?,
        ..usual
    };
    Some((mount, infrared?))
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
