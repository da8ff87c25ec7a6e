//! What a line is told and what it says.

use super::note::{LineNote, Note};
use crate::domain::command::{CommandAnswer, CommandRequest, Owner};
use crate::domain::ids::{AskerId, DriveIndex};
use crate::domain::link::PortKind;
use crate::domain::native::{NativeAnswer, NativeRequest};
use crate::domain::report::LineFault;
use crate::domain::time::MonoTime;
use crate::domain::traffic::TrafficRecord;
use crate::drive::snapshot::Presence;
use crate::drive::view::TripEvent;
use crate::journal::{Keep, RowNumber};

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Input<'a> {
    /// Bytes were read from the port.
    Bytes(&'a [u8]),
    /// A port of this kind was opened; nothing that was received before counts.
    PortUp(PortKind),
    /// The port is gone.
    PortDown(LineFault),
    /// A client asks for registers by their addresses.
    Native(NativeRequest),
    /// Somebody commands.
    Command(CommandRequest),
    /// The way from this commander is open: its session leases live on.
    PathAlive(Owner),
    /// The way from this commander was opened anew: what it had issued before is stale.
    PathOpened(Owner),
    /// The gateway ends: each drive gets the action that is declared for that.
    Shutdown,
    /// The line ends by a change of the configuration: nothing is accepted from now on but stops. A drive in use is
    /// stopped if that is wanted.
    Leave {
        /// It is.
        stops: bool,
    },
    /// It goes on after all.
    Stay,
    /// A client is gone: nobody waits for its answers any more, and what it has ordered and has not begun is not sent,
    /// stops excepted.
    AskerGone(AskerId),
    /// Everything that was to be kept, up to this row, is: it outlives a kill of the process.
    Kept(RowNumber),
    /// All that had happened has been told. Only now is decided what to do.
    Time,
}

/// Something that should be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Effect {
    /// Hand these bytes to the port, now and all at once.
    Transmit(Vec<u8>),
    /// Close the port and open it again after the usual wait, for this reason.
    Reopen(LineFault),
    /// Give this answer to its asker.
    Answer(NativeAnswer),
    /// Give this report to the one who commanded.
    Command(CommandAnswer),
    /// Keep this in the journal.
    Keep(Keep),
    /// A drive has tripped, or its trip holds no more. Where there is a journal, this is for the log alone: others are told
    /// from there.
    Trip(DriveIndex, TripEvent),
    /// Something that people should read.
    Note(DriveIndex, Note),
    /// The same about the line as a whole.
    LineNote(LineNote),
    /// A drive has come or gone.
    Presence(DriveIndex, Presence),
    /// For whoever watches the line; only while the line is to tell.
    Traffic(TrafficRecord),
}

/// When a line wants to be given the time again, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wake {
    /// At this moment.
    pub at: MonoTime,
    /// What it waits for.
    pub reason: WakeReason,
}

/// What a line can wait for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WakeReason {
    /// A reply, or the end of the wait for it.
    ReplyDue,
    /// The silence before the next frame.
    SilentInterval,
    /// The next poll, the end of a back-off, or the end of the time in which a late reply may come.
    WorkDue,
    /// The deadline of a request that waits.
    RequestDeadline,
    /// The silence that ends what is being received.
    FrameEnd,
    /// The moment by which something should have been heard, or a silent port is opened anew.
    LineCheck,
    /// The end of a lease, the deadline of a command, or the time by which a stop should show its effect.
    ControlDue,
}
