//! The simulated bus: any bytes of a master at any time, and only addressed drives answer.
//!
//! Input: flags (1 ASCII, 2 paced, 4 faults), the model, then events.

use super::feed::Feed;
use super::plant;
use std::sync::Arc;
use std::time::Duration;
use vfd_model::domain::ids::Station;
use vfd_model::domain::link::{Framing, LinkSettings};
use vfd_model::domain::time::MonoTime;
use vfd_model::wire::framing::{self, FrameAssembler};
use vfd_sim::sim::{BadRequest, BusOptions, BusPacing, DriveOptions, FaultPlan, SimBus, SimDrive};

const STATIONS: [u8; 2] = [1, 7];
/// Longer than any reply is delayed: everything due is sent by then.
const ALL_IS_OUT: Duration = Duration::from_secs(120);

pub fn run(bytes: &[u8]) {
    let mut feed = Feed::new(bytes);
    let flags = feed.byte();
    let framing = if flags & 1 == 0 {
        Framing::Rtu
    } else {
        Framing::Ascii
    };
    let pacing = if flags & 2 == 0 {
        BusPacing::None
    } else {
        BusPacing::CharacterTimes
    };
    let faults = if flags & 4 == 0 {
        FaultPlan::NONE
    } else {
        faults(&mut feed)
    };
    let model = Arc::new(plant::model(feed.byte()).on(framing));
    let mut bus = SimBus::new(
        LinkSettings::DEFAULT,
        BusOptions {
            framing,
            pacing,
            faults,
            ..BusOptions::default()
        },
        1,
    );
    for station in STATIONS {
        let bad_request = if station == 1 {
            BadRequest::Exception
        } else {
            BadRequest::AsDocumented
        };
        bus.connect(
            Station(station),
            SimDrive::new(
                Arc::clone(&model),
                DriveOptions {
                    bad_request,
                    ..Default::default()
                },
            ),
        );
    }
    let mut master = Master {
        bus,
        framing,
        now: MonoTime::from_millis(10_000),
        heard: Vec::new(),
        last: MonoTime::ZERO,
    };
    while !feed.is_empty() {
        master.event(&mut feed);
    }
    master.pass(ALL_IS_OUT);
    master.check(faults == FaultPlan::NONE && pacing == BusPacing::None);
}

fn faults(feed: &mut Feed<'_>) -> FaultPlan {
    let mut chance = || u16::from(feed.byte()) * 4 % 1001;
    let noise = chance();
    let lost = chance();
    let late = chance();
    FaultPlan {
        noise,
        lost,
        late,
        cut: chance(),
        flip: chance(),
        foreign: chance(),
        ..FaultPlan::NONE
    }
}

struct Master {
    bus: SimBus,
    framing: Framing,
    now: MonoTime,
    heard: Vec<u8>,
    /// When the last byte was received.
    last: MonoTime,
}

impl Master {
    fn event(&mut self, feed: &mut Feed<'_>) {
        match feed.byte() % 6 {
            0 => self.bus.receive(self.now, feed.piece()),
            1 | 2 => self.request(feed),
            3 => self.pass(feed.millis()),
            4 => self.pass(Duration::from_micros(feed.word().into())),
            _ => {
                let at = self.now;
                let station = Station(feed.one_of(&STATIONS));
                match (feed.flag(), self.bus.drive_mut(station)) {
                    (true, Some(drive)) => drive.trip(at, feed.word()),
                    _ => self.bus.set_powered(at, station, feed.flag()),
                }
            }
        }
    }

    fn request(&mut self, feed: &mut Feed<'_>) {
        let station = feed.byte() % 9;
        let pdu = feed.piece();
        let mut frame = Vec::new();
        framing::encode(self.framing, &mut frame, station, |out| {
            out.extend_from_slice(&pdu[..pdu.len().min(253)])
        });
        self.bus.receive(self.now, &frame);
    }

    /// Lets time pass as the owner of a bus does, from due byte to due byte.
    fn pass(&mut self, time: Duration) {
        let until = self.now + time;
        while let Some(due) = self.bus.next_due().filter(|due| *due <= until) {
            self.now = self.now.max(due);
            self.hear();
            assert!(
                self.bus.next_due().is_none_or(|next| next > self.now),
                "due for ever"
            );
        }
        self.now = until;
        self.hear();
    }

    fn hear(&mut self) {
        let now = self.now;
        let last = &mut self.last;
        let heard = &mut self.heard;
        self.bus.take_due(now, |at, bytes| {
            assert!(
                at <= now && at >= *last,
                "heard at {at:?}, after {last:?}, now {now:?}"
            );
            *last = at;
            heard.extend_from_slice(bytes);
        });
    }

    fn check(&self, is_undisturbed: bool) {
        let report = self.bus.report();
        assert!(
            report.replies_sent <= report.requests_heard,
            "more replies than requests: {report:?}"
        );
        let drives = STATIONS.map(|station| self.bus.exchange(Station(station)));
        assert!(drives.iter().sum::<u64>() <= report.requests_heard);
        if is_undisturbed {
            self.each_reply_is_sound(report.replies_sent);
        }
    }

    fn each_reply_is_sound(&self, replies: u64) {
        let mut assembler = FrameAssembler::new(self.framing);
        let mut found = 0;
        for byte in &self.heard {
            assembler.push(&[*byte]);
            while let Some(frame) = assembler.take(None) {
                let (station, _) =
                    framing::decode(self.framing, &frame.adu).expect("what is found is sound");
                assert!(
                    frame.noise.is_empty() && STATIONS.contains(&station),
                    "{frame:02X?}"
                );
                found += 1;
            }
        }
        assert_eq!((found, assembler.end()), (replies, Vec::new()));
    }
}
