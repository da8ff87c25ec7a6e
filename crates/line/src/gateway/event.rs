//! The inputs and effects of a line.

use super::note::{DriveNote, LineNote};
use crate::domain::command::{CommandAnswer, CommandRequest, Owner};
use crate::domain::ids::{AskerId, DriveIndex};
use crate::domain::link::PortKind;
use crate::domain::native::{NativeAnswer, NativeRequest};
use crate::domain::report::LineFault;
use crate::domain::time::MonoTime;
use crate::domain::traffic::TrafficRecord;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::TripEvent;
use crate::journal::{EntryToKeep, RowNumber};
use std::sync::Arc;

/// An input of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LineInput<'a> {
    /// Bytes were read from the port.
    Bytes(&'a [u8]),
    /// A port of this kind was opened; bytes received before are discarded.
    PortUp(PortKind),
    /// The port could not be opened, for this reason.
    PortRefused(Arc<str>),
    /// The port was lost.
    PortDown(LineFault),
    /// The server at the other end has closed the connection, which is no loss: until there is another one, nothing is sent.
    ConnectionClosed,
    /// There is another connection.
    ConnectionBack,
    /// A client reads or writes registers by address.
    Native(NativeRequest),
    /// A client gives a command.
    Command(CommandRequest),
    /// The connection of this client is open: its session leases stay alive.
    PathAlive(Owner),
    /// The connection of this client was reopened: what it issued before is stale.
    PathOpened(Owner),
    /// The sums of what this drive has used are set back to 0.
    ResetUsage(DriveIndex, Owner),
    /// This person confirms that the motor of a drive that is out of sight stands.
    ConfirmStandstill(DriveIndex, Owner),
    /// The gateway shuts down: each drive gets its declared action.
    Shutdown,
    /// The line ends by a change of the configuration: from now on only stops are accepted. A drive in use is stopped if
    /// requested.
    Leave {
        /// Whether drives in use are stopped.
        stops: bool,
    },
    /// The line stays after all.
    Stay,
    /// Another gateway of the line is to take it over, if this one is active.
    Yield,
    /// A client is gone: its answers are dropped, and its orders that have not begun are not sent, except stops.
    AskerGone(AskerId),
    /// Everything up to this row of the journal is durable: it survives a kill of the process.
    Kept(RowNumber),
    /// All events so far have been handed in. Decisions are made only now.
    Time,
}

/// An action for the caller to execute.
#[derive(Clone, Debug, PartialEq)]
pub enum LineEffect {
    /// Write these bytes to the port, at once and in one piece, if [`may_transmit`](super::LineCore::may_transmit) still allows
    /// that, and say with [`transmitted`](super::LineCore::transmitted) that it is done.
    Transmit(Vec<u8>),
    /// Close the port and open it again after the usual wait, for this reason.
    Reopen(LineFault),
    /// Deliver this answer to its client.
    Answer(NativeAnswer),
    /// Deliver this report to the client that gave the command.
    Command(CommandAnswer),
    /// Keep this in the journal.
    Keep(EntryToKeep),
    /// A drive has tripped, or its trip is over. With a journal, this is for the log alone: clients are informed from
    /// there.
    Trip(DriveIndex, TripEvent),
    /// Log this note on a drive.
    Note(DriveIndex, DriveNote),
    /// Log this note on the line as a whole.
    LineNote(LineNote),
    /// A drive went online or offline.
    Presence(DriveIndex, DrivePresence),
    /// For watchers of the line; only while traffic is reported.
    Traffic(TrafficRecord),
}

/// When [`LineInput::Time`] is due, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineWake {
    /// At this moment.
    pub at: MonoTime,
    /// The reason.
    pub reason: WakeReason,
}

/// Reasons to wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WakeReason {
    /// A reply, or the end of the wait for it.
    ReplyDue,
    /// The silence before the next frame.
    SilentInterval,
    /// The next poll, the end of a back-off, or the end of the time in which a late reply may arrive.
    WorkDue,
    /// The deadline of a request that waits.
    RequestDeadline,
    /// The silence that ends the frame being received.
    FrameEnd,
    /// The deadline for hearing anything, after which a silent port is reopened.
    LineCheck,
    /// The end of a lease, the deadline of a command, or the time by which a stop should show its effect.
    ControlDue,
}
