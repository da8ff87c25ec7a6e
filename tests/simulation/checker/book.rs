//! The known state of one drive: its orders, its stop, what it accepted and what it showed.

use super::tables::Run;

/// What one request orders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wish {
    pub run: Option<Run>,
    /// In 0.01 Hz.
    pub setpoint: Option<u16>,
    /// A listed register with its word.
    pub register: Option<(u16, u16)>,
}

/// One order.
#[derive(Clone, Copy, Debug)]
pub struct Order {
    pub number: u64,
    pub wish: Wish,
    pub at: u64,
    /// Its first frame is sent before this moment or never.
    pub before: u64,
    /// Its frames so far, and how many of them the drive accepted.
    pub sent: u32,
    pub taken: u32,
    pub has_run: bool,
    pub has_setpoint: bool,
    pub has_register: bool,
    /// Words of a reset that were sent.
    pub reset_step: usize,
    /// A stop arrived after it, or was pending when it arrived.
    pub is_void: bool,
    pub is_over: bool,
    /// It arrived over MQTT.
    pub is_message: bool,
    /// When it was issued, if it was too old on arrival.
    pub issued_old: Option<u64>,
}

/// The stop of a drive.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stop {
    /// It was accepted, or the declared action began, without a visible effect so far.
    pub is_pending: bool,
    pub was_accepted_at: Option<u64>,
    pub is_coast: bool,
    /// The drive accepted it, in an exchange whose reply was received.
    pub echoed: bool,
    pub last_output: Option<u16>,
    pub zeros: u32,
}

/// The known state of one drive.
#[derive(Debug, Default)]
pub struct Book {
    pub orders: Vec<Order>,
    /// The number of the last stop.
    newest_stop: u64,
    pub stop: Stop,
    /// Stops that arrived at this very moment and may turn out to change nothing.
    pub fresh: Vec<(u64, u64, bool)>,
    /// The address of the client of the last stop, if it was one, with whether that was a coast; and the number of the
    /// last stop that may be one more of the same, which is no new one.
    pub stopped_by: Option<(usize, bool)>,
    pub repeat: Option<u64>,
    /// What the drive accepted last.
    pub run_taken: Option<Run>,
    pub setpoint_taken: Option<u16>,
    /// When the last order with a sent frame arrived.
    pub moved_at: Option<u64>,
    /// The last heartbeat of any client.
    pub sign_at: u64,
    /// The drive accepted RUN, and was not seen at rest since.
    pub is_running: bool,
    pub zeros: u32,
    /// When the last stop of any client arrived, whether a stop or a coast ever arrived, and how often one was answered
    /// since.
    pub last_stop_at: u64,
    pub asked: [bool; 2],
    pub echoes: u32,
    /// A stop arrived that perhaps changed nothing.
    pub may_stop: Option<(u64, u64)>,
    pub is_ending: bool,
    /// Its lease, or a stop, is from before a restart of the gateway, and it was not seen running since.
    pub is_orphaned: bool,
    pub remembered_stop: bool,
    pub awaits_sight: bool,
    /// An order arrived over MQTT since the last stop.
    pub is_of_mqtt: bool,
    /// When the last new stop arrived, and until when its frame must be sent.
    pub stopped_at: Option<u64>,
    pub stop_due: Option<u64>,
    /// Actual output frequencies with their times, newest last.
    pub readings: [(u16, u64); 24],
    pub reading: usize,
}

/// A list that has not reached its run word by this long after its deadline never does.
const LIST_TAKES: u64 = 500_000_000;

impl Order {
    /// It orders to run, and its first words were sent, but its run word was not and never will be.
    fn is_given_up(&self, at: u64) -> bool {
        self.sent > 0 && !self.has_run && at >= self.before + LIST_TAKES
    }

    fn starts(&self) -> bool {
        matches!(self.wish.run, Some(Run::Forward | Run::Reverse))
    }
}

impl Book {
    /// A stop may be in force already: the drive took one, and no order to run could still be sent. What came at this
    /// very moment may have been refused, which is not known before the end of the moment.
    pub fn may_be_stopped(&self, at: u64) -> bool {
        let may_come = |it: &Order| {
            if it.sent > 0 {
                !it.has_run && !it.is_given_up(at)
            } else {
                at < it.before
            }
        };
        let is_open = |it: &Order| !it.is_over && !it.is_void && it.starts() && it.at < at;
        let is_ordered = self.orders.iter().any(|it| is_open(it) && may_come(it));
        let is_stopped =
            !matches!(self.run_taken, Some(Run::Forward | Run::Reverse)) || self.zeros >= 2;
        !self.stop.is_pending && is_stopped && !is_ordered
    }

    /// No frame may follow from a list that counts as given up.
    pub fn void_given_up(&mut self, at: u64) {
        self.orders
            .iter_mut()
            .filter(|it| it.starts() && it.is_given_up(at))
            .for_each(|it| it.is_void = true);
    }

    /// The stop `number` was answered while the motor rested: it changed nothing, and orders of clients that came after the
    /// newest stop count.
    pub fn stop_was_none(&mut self, number: u64) {
        self.stop.is_pending = false;
        let newest = self.newest_stop.max(number);
        let counts = |it: &&mut Order| {
            it.number > newest && !it.is_message && it.issued_old.is_none() && it.sent == 0
        };
        self.orders
            .iter_mut()
            .filter(counts)
            .for_each(|it| it.is_void = false);
    }

    /// A stop arrives, perhaps of a client. If that client's last command was the same stop, it is a repeat.
    pub fn stop_comes(&mut self, at: u64, number: u64, by: Option<usize>, is_coast: bool) {
        self.newest_stop = number;
        let by = by.map(|by| (by, is_coast));
        let has_moved = self.moved_at > Some(self.last_stop_at);
        self.last_stop_at = at;
        self.echoes = 0;
        if by.is_some() && by == self.stopped_by && !has_moved {
            self.repeat = Some(number);
        }
        self.stopped_by = by;
    }

    /// The order `number` was answered. Frames of two resets look the same: if it is a reset with fewer words sent than
    /// a later one, the frames were its own.
    pub fn reset_answered(&mut self, number: u64) {
        let is_reset = |it: &Order| it.wish.run == Some(Run::Reset) && !it.is_over;
        let Some(place) = self
            .orders
            .iter()
            .position(|it| it.number == number && is_reset(it))
        else {
            return;
        };
        let (until, later) = self.orders.split_at_mut(place + 1);
        let Some(answered) = until.last_mut() else {
            return;
        };
        let is_ahead = |it: &&mut Order| is_reset(it) && it.reset_step > answered.reset_step;
        let Some(other) = later.iter_mut().find(is_ahead) else {
            return;
        };
        std::mem::swap(&mut answered.reset_step, &mut other.reset_step);
        std::mem::swap(&mut answered.sent, &mut other.sent);
        std::mem::swap(&mut answered.taken, &mut other.taken);
    }

    pub fn shows_output(&mut self, at: u64, output: u16) {
        self.readings[self.reading % 24] = (output, at);
        self.reading += 1;
        self.zeros = if output == 0 { self.zeros + 1 } else { 0 };
        self.is_running &= self.zeros < 2;
        let stop = &mut self.stop;
        stop.zeros = if output == 0 { stop.zeros + 1 } else { 0 };
        let falls = stop.last_output.is_some_and(|last| output < last);
        stop.last_output = Some(output);
        if stop.zeros >= 2 {
            // A drive that was out of sight is read first, and at standstill there is nothing to stop.
            self.stop_due = None;
        }
        if stop.zeros >= 2 || (stop.echoed && (output == 0 || falls)) {
            stop.is_pending = false;
        }
    }

    pub fn shows_status(&mut self, is_running: bool) {
        if !is_running && self.stop.echoed {
            self.stop.is_pending = false;
        }
    }
}
