//! A number by which the gateways of one line see whether their files agree.

use super::setup::{DriveSetup, LineSetup};
use crate::domain::command::Direction;
use crate::domain::control::{ControlSettings, FailSafe};
use crate::domain::standby::OnGatewayLost;
use crate::profile::model::{FractionWhole, Model};

/// A digest of what the gateways of a line must have in common: its drives, their limits and what is declared for them. It is
/// made of numbers and words of the configuration, so that it is the same in each version and however a list is ordered.
pub(super) fn digest(setup: &LineSetup) -> u16 {
    let of_drive = |drive: &DriveSetup| {
        let control = drive.control.as_deref().map(of_control).unwrap_or_default();
        format!(
            "{} {} {} {control}",
            drive.station.0,
            drive.model.id,
            full_scales(&drive.model)
        )
    };
    let mut drives: Vec<_> = setup.drives.iter().map(of_drive).collect();
    drives.sort();
    // FNV-1a.
    let hash = drives
        .join("\n")
        .bytes()
        .fold(0xCBF2_9CE4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
        });
    u16::try_from((hash ^ (hash >> 16) ^ (hash >> 32) ^ (hash >> 48)) & 0xFFFF).unwrap_or_default()
}

fn of_control(control: &ControlSettings) -> String {
    let ControlSettings {
        least,
        most,
        directions,
        lost_after,
        on_gateway_lost,
        ..
    } = control;
    let [forward, reverse] =
        [Direction::Forward, Direction::Reverse].map(|it| u8::from(directions.contains(&it)));
    let actions = [control.on_commander_lost, control.on_shutdown]
        .map(FailSafe::keyword)
        .join(" ");
    let on_gateway_lost = on_gateway_lost.map_or("none", OnGatewayLost::keyword);
    let (bus, outside) = (control.bus.keyword(), control.on_output_outside.keyword());
    let (least, most, lost_after) = (
        least.millihertz(),
        most.millihertz(),
        lost_after.as_millis(),
    );
    format!(
        "{least} {most} {forward} {reverse} {lost_after} {actions} {on_gateway_lost} {bus} {outside}"
    )
}

/// The full scales that the configuration states for registers of `model`, in millihertz.
fn full_scales(model: &Model) -> String {
    let scales = model
        .registers
        .iter()
        .filter_map(|register| register.form.full_scale.as_ref());
    let stated = scales.filter_map(|scale| match scale.of {
        FractionWhole::Fixed(hertz) => Some(hertz.millihertz().to_string()),
        FractionWhole::Configured | FractionWhole::Register(_) => None,
    });
    stated.collect::<Vec<_>>().join(",")
}
