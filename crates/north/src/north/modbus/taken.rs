//! What one of the gateway's own units makes of a request.

use super::answer::ModbusAnswer;
use super::refusal::exception_of;
use super::words::WordBuffer;
use crate::domain::command::{Order, Owner, Reason};
use crate::domain::standby::LineRole;
use crate::domain::time::MonoTime;

/// When a unit is asked, and by which client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RequestContext {
    /// Now.
    pub now: MonoTime,
    /// Seconds since the gateway's start.
    pub uptime_s: u32,
    /// The client.
    pub owner: Owner,
    /// The gateway's role on the line of the drive; `None` if it is the only gateway there.
    pub standby: Option<LineRole>,
}

/// What is to be done with a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RequestAction {
    /// Answer with the words that were filled in.
    Words,
    /// Answer with these bits, at most 16, the first in the lowest.
    Bits {
        /// The bits.
        bits: u16,
        /// How many.
        count: u16,
    },
    /// Answer with this identity.
    Identity(Vec<u8>),
    /// The request orders nothing: answer that it is done.
    Nothing,
    /// Give this order to the drive, and answer when it is answered.
    Order(Order),
    /// Order every drive to stop that is served and has control, and answer when all are answered.
    StopAll,
    /// A read of an address that does not exist: answer with this exception.
    Exception(u8),
    /// A write that is refused for this reason.
    Refused(Reason),
}

impl RequestAction {
    /// Calls `answer` with the answer that can be given at once; it is not called for an order. `words` are those that
    /// were filled in.
    ///
    /// # Errors
    /// What has to be ordered first.
    pub fn at_once<T>(
        self,
        words: &WordBuffer,
        answer: impl FnOnce(ModbusAnswer<'_>) -> T,
    ) -> Result<T, RequestedOrder> {
        Ok(match self {
            Self::Words => answer(ModbusAnswer::Words(words.as_slice())),
            Self::Bits { bits, count } => {
                let bytes = bits.to_le_bytes();
                answer(ModbusAnswer::Bits(
                    bytes
                        .get(..usize::from(count.div_ceil(8)))
                        .unwrap_or_default(),
                ))
            }
            Self::Identity(bytes) => answer(ModbusAnswer::Identity(&bytes)),
            Self::Nothing => answer(ModbusAnswer::Written),
            Self::Exception(code) => answer(ModbusAnswer::Exception(code)),
            Self::Refused(reason) => answer(ModbusAnswer::Exception(exception_of(reason))),
            Self::Order(order) => return Err(RequestedOrder::One(order)),
            Self::StopAll => return Err(RequestedOrder::StopAll),
        })
    }
}

/// What has to be ordered before there is an answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RequestedOrder {
    /// An order for the addressed drive.
    One(Order),
    /// A stop of every drive that is served and has control.
    StopAll,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_needs_no_drive_is_an_answer_at_once() {
        let mut words = WordBuffer::default();
        words.fill(1, 2, Some);
        let text = |taken: RequestAction| taken.at_once(&words, |answer| format!("{answer:?}"));
        assert_eq!(text(RequestAction::Words).unwrap(), "Words([1, 2])");
        assert_eq!(
            text(RequestAction::Bits {
                bits: 0x0305,
                count: 8
            })
            .unwrap(),
            "Bits([5])"
        );
        assert_eq!(
            text(RequestAction::Bits {
                bits: 0x0305,
                count: 10
            })
            .unwrap(),
            "Bits([5, 3])"
        );
        assert_eq!(
            text(RequestAction::Identity(vec![7])).unwrap(),
            "Identity([7])"
        );
        assert_eq!(text(RequestAction::Nothing).unwrap(), "Written");
        assert_eq!(text(RequestAction::Exception(2)).unwrap(), "Exception(2)");
        assert_eq!(
            text(RequestAction::Refused(Reason::NotListed)).unwrap(),
            "Exception(2)"
        );
        assert_eq!(
            text(RequestAction::Order(Order::Renew)),
            Err(RequestedOrder::One(Order::Renew))
        );
        assert_eq!(text(RequestAction::StopAll), Err(RequestedOrder::StopAll));
    }
}
