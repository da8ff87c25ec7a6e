//! A drive that answers some requests in the wrong form, each with one sound frame, is no second drive of its number: both
//! frames are shown, and its trips are believed.

use crate::support::families::{accepting, rig_of};
use crate::support::model;
use std::time::Duration;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::suspicion::LineSuspicion;
use vfd_gateway::drive::view::TripEventKind;
use vfd_gateway::profile::model::RegisterRole;

const SECOND: Duration = Duration::from_secs(1);

#[test]
fn its_trips_are_told_and_the_form_is_named() {
    let model = model("hyundai-n700");
    let source = model
        .register_for(RegisterRole::FrequencySource)
        .unwrap()
        .address;
    let mut rig = rig_of(&model, accepting());
    rig.live(SECOND * 5);
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .answers_too_long_at(source);
    rig.live(SECOND * 120);
    let suspicion = rig.core.report().suspicion;
    let Some(LineSuspicion::WrongReplies {
        station: Station(1),
        request,
        reply,
    }) = suspicion
    else {
        panic!("{suspicion:?}")
    };
    let start = format!(
        "01 03 {:02X} {:02X}",
        source.number() >> 8,
        source.number() & 0xFF
    );
    assert!(request.to_string().starts_with(&start), "{request}");
    assert!(reply.to_string().starts_with("01 03 "), "{reply}");
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, 7);
    rig.live(SECOND * 10);
    let [(_, event)] = rig.trips.as_slice() else {
        panic!("{:?}", rig.trips)
    };
    let TripEventKind::Tripped { trips: 1, record } = &event.kind else {
        panic!("{event:?}")
    };
    assert_eq!(record.code, Some(7));
    let count = model.register_for(RegisterRole::TripCount).unwrap().address;
    assert!(
        rig.view(0)
            .snapshot
            .reading(count)
            .is_some_and(|it| rig.now.since(it.at) < SECOND * 5)
    );
}
