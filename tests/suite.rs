//! The one integration binary. What belongs where:
//!
//! | folder | what lives there |
//! | --- | --- |
//! | `scenarios/` | one file per promise: what must happen, told with real frames or a whole gateway |
//! | `properties/` | what must hold for any input: random bytes, random lists of events, kept seeds |
//! | `simulation/` | a whole gateway under one seed and one clock, and who looks on; also of the bench `year` |
//! | `support/` | what several of them need: rigs, transcripts, reference models |
//! | `../fuzz/src/` | what the fuzzer and these tests play its corpus through |
//! | `golden/`, `data/` | texts and tables that tests compare with; no code |
//!
//! Tests that start the real program have a binary of their own. A file is added by a `mod` line here.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::too_many_lines,
    reason = "a test fails by panicking, its helpers too, and is one story"
)]

#[path = "scenarios/followed_orders.rs"]
mod followed_orders;
#[path = "scenarios/frames.rs"]
mod frames;

#[path = "properties/ascii.rs"]
mod ascii;
#[path = "properties/assembler.rs"]
mod assembler;
#[path = "properties/connection.rs"]
mod connection;
#[path = "properties/control.rs"]
mod control;
#[path = "properties/corpus.rs"]
mod corpus;
#[path = "../fuzz/src/lib.rs"]
mod fuzz_targets;
#[path = "properties/line_core.rs"]
mod line_core;
#[path = "properties/orders.rs"]
mod orders_property;
#[path = "properties/run_words.rs"]
mod run_words;

#[allow(dead_code, reason = "shared with the bench, which uses more of it")]
mod simulation;
#[path = "simulation/tests.rs"]
mod simulation_tests;
mod support;

#[path = "simulation/accounting.rs"]
mod accounting;
#[path = "scenarios/ascii_line.rs"]
mod ascii_line;
#[path = "scenarios/back_doors.rs"]
mod back_doors;
#[path = "scenarios/barriers.rs"]
mod barriers;
#[path = "scenarios/by_time.rs"]
mod by_time;
#[path = "scenarios/cached.rs"]
mod cached;
#[path = "scenarios/coils.rs"]
mod coils;
#[path = "scenarios/commander_lost.rs"]
mod commander_lost;
#[path = "scenarios/commands.rs"]
mod commands;
#[path = "scenarios/commits.rs"]
mod commits;
#[path = "scenarios/conversation.rs"]
mod conversation;
#[path = "scenarios/deaf_times.rs"]
mod deaf_times;
#[path = "scenarios/echoes_in_doubt.rs"]
mod echoes_in_doubt;
#[path = "scenarios/every_request_ends.rs"]
mod every_request_ends;
#[path = "scenarios/exception_kinds.rs"]
mod exception_kinds;
#[path = "scenarios/field_faults.rs"]
mod field_faults;
#[path = "scenarios/full_scale.rs"]
mod full_scale;
#[path = "scenarios/gone_client.rs"]
mod gone_client;
#[path = "scenarios/holes.rs"]
mod holes;
#[path = "scenarios/interlocks.rs"]
mod interlocks;
#[path = "scenarios/kept.rs"]
mod kept;
#[path = "scenarios/late_reply.rs"]
mod late_reply;
#[path = "scenarios/learned_times.rs"]
mod learned_times;
#[path = "scenarios/leaving.rs"]
mod leaving;
#[path = "scenarios/modbus_tcp_line.rs"]
mod modbus_tcp_line;
#[path = "scenarios/model_conversations.rs"]
mod model_conversations;
#[path = "scenarios/native_blocks.rs"]
mod native_blocks;
#[path = "scenarios/noisy_line.rs"]
mod noisy_line;
#[path = "scenarios/old_value_or_exception.rs"]
mod old_value_or_exception;
#[path = "scenarios/orders_apart.rs"]
mod orders_apart;
#[path = "scenarios/out_of_sight.rs"]
mod out_of_sight;
#[path = "scenarios/output_limits.rs"]
mod output_limits;
#[path = "scenarios/ownership.rs"]
mod ownership;
#[path = "scenarios/pairs.rs"]
mod pairs;
#[path = "scenarios/pauses.rs"]
mod pauses;
#[path = "scenarios/plausible.rs"]
mod plausible;
#[path = "scenarios/polls.rs"]
mod polls;
#[path = "scenarios/port_comes_and_goes.rs"]
mod port_comes_and_goes;
#[path = "scenarios/preconditions.rs"]
mod preconditions;
#[path = "scenarios/ram_forms.rs"]
mod ram_forms;
#[path = "scenarios/refresh.rs"]
mod refresh;
#[path = "scenarios/refused_registers.rs"]
mod refused_registers;
#[path = "scenarios/release_and_setup.rs"]
mod release_and_setup;
#[path = "scenarios/resets.rs"]
mod resets;
#[path = "scenarios/restarts.rs"]
mod restarts;
#[path = "scenarios/setpoint_before_run.rs"]
mod setpoint_before_run;
#[path = "scenarios/setpoint_facts.rs"]
mod setpoint_facts;
#[path = "scenarios/shaped_bursts.rs"]
mod shaped_bursts;
#[path = "scenarios/sharing.rs"]
mod sharing;
#[path = "scenarios/sheets.rs"]
mod sheets;
#[path = "scenarios/signed_setpoints.rs"]
mod signed_setpoints;
#[path = "scenarios/signs.rs"]
mod signs;
#[path = "scenarios/standby.rs"]
mod standby;
#[path = "scenarios/standby_ears.rs"]
mod standby_ears;
#[path = "scenarios/standby_equal_ranks.rs"]
mod standby_equal_ranks;
#[path = "scenarios/standby_hand_over.rs"]
mod standby_hand_over;
#[path = "scenarios/standby_latched.rs"]
mod standby_latched;
#[path = "scenarios/standby_orders.rs"]
mod standby_orders;
#[path = "scenarios/standby_play/mod.rs"]
mod standby_play;
#[path = "scenarios/standby_roll_call.rs"]
mod standby_roll_call;
#[path = "scenarios/standby_stops.rs"]
mod standby_stops;
#[path = "scenarios/standby_trouble.rs"]
mod standby_trouble;
#[path = "scenarios/standing_bits.rs"]
mod standing_bits;
#[path = "scenarios/starts.rs"]
mod starts;
#[path = "scenarios/stop_all.rs"]
mod stop_all;
#[path = "scenarios/stop_wins.rs"]
mod stop_wins;
#[path = "scenarios/trials.rs"]
mod trials;
#[path = "scenarios/trips.rs"]
mod trips;
#[path = "scenarios/unanswered_writes.rs"]
mod unanswered_writes;
#[path = "scenarios/undocumented_states.rs"]
mod undocumented_states;
#[path = "scenarios/unproven.rs"]
mod unproven;
#[path = "scenarios/untrue_readings.rs"]
mod untrue_readings;
#[path = "scenarios/usage.rs"]
mod usage;
#[path = "scenarios/walk.rs"]
mod walk;
#[path = "scenarios/warnings.rs"]
mod warnings;
#[path = "scenarios/watchdog.rs"]
mod watchdog;
#[path = "scenarios/watching.rs"]
mod watching;
#[path = "scenarios/without_06.rs"]
mod without_06;
#[path = "scenarios/written_zero.rs"]
mod written_zero;
#[path = "scenarios/wrong_replies.rs"]
mod wrong_replies;
#[path = "scenarios/zero_words.rs"]
mod zero_words;
