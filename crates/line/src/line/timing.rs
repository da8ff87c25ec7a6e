//! The duration of characters and silences on one line.

use crate::domain::link::{Framing, LinkSettings};
use crate::profile::model::Model;
use crate::wire::framing;
use std::time::Duration;

/// Above this speed the silence no longer depends on the character time (Modbus over serial line V1.02, 2.5.1.1).
pub const FIXED_SILENCE_ABOVE_BAUD: u32 = 19_200;
/// The silence above that speed.
pub const FIXED_SILENCE: Duration = Duration::from_micros(1_750);

/// Minimum silence between RTU frames, in characters.
pub const LEAST_GAP_CHARS: f64 = 3.5;
/// Minimum silence between ASCII frames. The standard requires none; drives require this much.
pub const ASCII_SILENCE: Duration = Duration::from_millis(10);
/// Longest pause between two characters of an ASCII frame (Modbus over serial line V1.02, 2.5.2.1).
pub const ASCII_HOLE: Duration = Duration::from_secs(1);

/// Longest pause that an adapter inserts between two characters of a reply: the latency timer of common USB chips is
/// 16 ms, and the bus and the driver take a little more. On a serial port, later bytes are not part of the same frame.
pub const ADAPTER_HOLE: Duration = Duration::from_millis(20);

/// Times of one line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineTiming {
    /// How frames are delimited.
    pub framing: Framing,
    /// Speed and character format.
    pub link: LinkSettings,
    /// Silence before each of our frames.
    pub silence: Duration,
    /// Whether characters take time at all: false for Modbus TCP, and for a pseudo-terminal or a network port with a
    /// silence of its own.
    pub paced: bool,
}

impl LineTiming {
    /// Times of a line with `models`: the longest silence that one of them needs, at least `min_request_gap`.
    #[must_use]
    pub fn for_models<'a>(
        framing: Framing,
        link: LinkSettings,
        models: impl IntoIterator<Item = &'a Model>,
        min_request_gap: Duration,
    ) -> Self {
        let least = match framing {
            Framing::Ascii => ASCII_SILENCE,
            Framing::Rtu if link.baud > FIXED_SILENCE_ABOVE_BAUD => FIXED_SILENCE,
            Framing::Rtu | Framing::Mbap => Duration::ZERO,
        };
        let needed = models
            .into_iter()
            .map(|model| silence_for(model, framing, link))
            .max()
            .unwrap_or_default();
        Self {
            framing,
            link,
            silence: needed.max(least).max(min_request_gap),
            paced: framing.has_characters(),
        }
    }

    /// This line without character times and with `silence` as its silence, for a pseudo-terminal or a network port.
    #[must_use]
    pub const fn unpaced(self, silence: Duration) -> Self {
        Self {
            silence,
            paced: false,
            ..self
        }
    }

    /// Whether a device may stand between that asks the drives by itself, one after the other.
    #[must_use]
    pub const fn may_have_converter(&self) -> bool {
        matches!(self.framing, Framing::Mbap)
    }

    /// Time that `bytes` bytes take on the wire.
    #[must_use]
    pub fn on_wire(&self, bytes: usize) -> Duration {
        if self.paced {
            self.link.bytes(bytes)
        } else {
            Duration::ZERO
        }
    }

    /// Bytes on the wire of the frame that carries a PDU of `pdu_bytes`.
    #[must_use]
    pub const fn adu_bytes(&self, pdu_bytes: usize) -> usize {
        framing::adu_bytes(self.framing, pdu_bytes)
    }

    /// Pause between two characters after which an incomplete frame is discarded; `None` where its rest always follows.
    #[must_use]
    pub const fn longest_hole(&self) -> Option<Duration> {
        match self.framing {
            Framing::Rtu => Some(self.silence),
            Framing::Ascii => Some(ASCII_HOLE),
            Framing::Mbap => None,
        }
    }
}

/// Silence that `model` needs before a frame. The gap in characters applies to RTU only: it is what separates frames.
fn silence_for(model: &Model, framing: Framing, link: LinkSettings) -> Duration {
    let pause = model
        .quirks
        .pause_before_request
        .as_ref()
        .map_or(Duration::ZERO, |pause| pause.value);
    match framing {
        Framing::Rtu => link
            .chars(model.timing.gap_chars.value.max(LEAST_GAP_CHARS))
            .max(pause),
        Framing::Ascii | Framing::Mbap => pause,
    }
}

#[cfg(test)]
pub(super) mod testing {
    //! Timings shared by the tests of this room.

    use super::*;
    use crate::domain::link::Parity;

    /// An RTU line of the Hyundai N700 as it comes from the factory: 4.5 characters of silence.
    pub const N700: LineTiming = LineTiming {
        framing: Framing::Rtu,
        link: LinkSettings::DEFAULT,
        silence: Duration::from_nanos(4_687_500),
        paced: true,
    };

    /// An ASCII line with 7 data bits and even parity at the same speed.
    pub const ASCII: LineTiming = LineTiming {
        framing: Framing::Ascii,
        link: LinkSettings {
            data_bits: 7,
            parity: Parity::Even,
            ..LinkSettings::DEFAULT
        },
        silence: ASCII_SILENCE,
        paced: true,
    };
}

#[cfg(test)]
mod tests {
    use super::testing::{ASCII, N700};
    use super::*;
    use crate::profile::model::{Confidence, Fact};
    use crate::vendors;

    fn model(gap_chars: f64, pause: Option<Duration>) -> Model {
        let catalog = vendors::catalog();
        let mut model = Model::clone(catalog.find("hyundai-n700").unwrap());
        model.timing.gap_chars.value = gap_chars;
        let fact = |value| Fact {
            value,
            confidence: Confidence::Manual,
            source: "IM 1".to_owned(),
        };
        model.quirks.pause_before_request = pause.map(fact);
        model
    }

    #[test]
    fn the_largest_gap_of_a_line_counts() {
        let short = model(3.5, None);
        let long = model(4.5, None);
        let link = LinkSettings::DEFAULT;
        let silence =
            |link, gap| LineTiming::for_models(Framing::Rtu, link, [&short, &long], gap).silence;
        assert_eq!(
            LineTiming::for_models(Framing::Rtu, link, [&short, &long], Duration::ZERO),
            N700
        );
        assert_eq!(
            silence(link, Duration::from_millis(20)),
            Duration::from_millis(20)
        );
        assert_eq!(
            silence(
                LinkSettings {
                    baud: 38_400,
                    ..link
                },
                Duration::ZERO
            ),
            FIXED_SILENCE
        );
    }

    #[test]
    fn gaps_in_characters_do_not_apply_to_ascii() {
        let slow = model(100.0, None);
        let silence = |models: &[&Model], gap| {
            LineTiming::for_models(Framing::Ascii, ASCII.link, models.iter().copied(), gap).silence
        };
        assert_eq!(silence(&[&slow], Duration::ZERO), Duration::from_millis(10));
        assert_eq!(
            silence(&[&slow], Duration::from_millis(30)),
            Duration::from_millis(30)
        );
        assert_eq!(
            silence(
                &[&slow, &model(3.5, Some(Duration::from_millis(20)))],
                Duration::ZERO
            )
            .as_millis(),
            20
        );
    }

    #[test]
    fn a_pause_that_a_model_needs_counts_on_rtu_lines_too() {
        let models = [
            model(4.5, None),
            model(3.5, Some(Duration::from_millis(20))),
        ];
        let timing =
            LineTiming::for_models(Framing::Rtu, LinkSettings::DEFAULT, &models, Duration::ZERO);
        assert_eq!(timing.silence, Duration::from_millis(20));
    }

    #[test]
    fn over_modbus_tcp_characters_take_no_time_and_only_a_pause_of_the_drive_counts() {
        let timing = |pause, gap| {
            let model = model(4.5, pause);
            LineTiming::for_models(Framing::Mbap, LinkSettings::DEFAULT, [&model], gap)
        };
        let plain = timing(None, Duration::ZERO);
        assert_eq!(
            (plain.silence, plain.on_wire(260), plain.longest_hole()),
            (Duration::ZERO, Duration::ZERO, None)
        );
        assert_eq!(plain.adu_bytes(5), 12);
        let ms = Duration::from_millis;
        assert_eq!(
            (
                timing(Some(ms(20)), ms(5)).silence,
                timing(None, ms(5)).silence
            ),
            (ms(20), ms(5))
        );
    }

    #[test]
    fn frames_take_the_bytes_and_bits_of_their_framing() {
        // 10 bits a character: 7 data bits with parity cost as much as 8 without.
        assert_eq!(N700.adu_bytes(5), 8);
        assert_eq!(ASCII.adu_bytes(5), 17);
        assert_eq!(N700.on_wire(8), Duration::from_nanos(8_333_334));
        assert_eq!(ASCII.on_wire(17), Duration::from_nanos(17_708_334));
        let holes = (N700.longest_hole(), ASCII.longest_hole());
        assert_eq!(holes, (Some(N700.silence), Some(Duration::from_secs(1))));
        assert_eq!(ASCII.unpaced(Duration::ZERO).on_wire(17), Duration::ZERO);
    }
}
