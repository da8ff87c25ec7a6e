//! Metrics as OpenMetrics text, built at each scrape from what the lines publish.

use super::state::HttpState;
use super::table::{self, MetricFamily, MetricName, MetricSample};
use crate::daemon::exchange::shared::{SharedDrive, SharedPlant};
use crate::domain::counts::ReplyCounts;
use crate::domain::report::REPLY_CLASSES;
use crate::domain::time::MonoTime;
use crate::domain::version::PROGRAM_VERSION;
use crate::drive::view::DriveView;
use crate::north::shown;
use crate::profile::model::{PollClass, Register, RegisterRole};
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, MetricEncoder, NoLabelSet, text};
use prometheus_client::registry::{Registry, Unit};
use std::collections::HashSet;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// Names and values of the labels of one sample.
type Labels<'a> = Vec<(&'static str, &'a str)>;

/// All metrics as of `now`.
///
/// # Errors
/// The encoder's; writing text never fails.
pub(super) fn text(state: Arc<HttpState>, now: MonoTime) -> Result<String, fmt::Error> {
    let mut registry = Registry::with_prefix(table::PREFIX);
    registry.register_collector(Box::new(MetricsScrape { state, now }));
    let mut written = String::new();
    text::encode(&mut written, &registry)?;
    Ok(written)
}

#[derive(Debug)]
struct MetricsScrape {
    state: Arc<HttpState>,
    now: MonoTime,
}

impl Collector for MetricsScrape {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> fmt::Result {
        let state = &self.state;
        let shared = self.state.shared.get();
        let version = vec![("version", PROGRAM_VERSION), ("gateway", &state.gateway)];
        gauges(&mut encoder, &table::BUILD, [(version, 1.0)])?;
        each(&mut encoder, table::GATEWAY, || {
            [(Vec::new(), state.as_ref())]
        })?;
        let reports: Vec<_> = shared
            .lines
            .iter()
            .map(|line| (line.name.as_str(), line.report()))
            .collect();
        each(&mut encoder, table::LINE, || {
            reports
                .iter()
                .map(|(name, report)| (vec![("line", *name)], report))
        })?;
        let drives: Vec<_> = shared
            .drives
            .iter()
            .map(|drive| (drive.as_ref(), drive.view.load_full()))
            .collect();
        each(&mut encoder, &table::DRIVE, || {
            drives
                .iter()
                .map(|(drive, view)| (labels(drive), view.as_ref()))
        })?;
        each(&mut encoder, table::THREAD, || {
            shared
                .lines
                .iter()
                .map(|line| (vec![("line", line.name.as_str())], line.as_ref()))
        })?;
        self.stations(&mut encoder, &shared)?;
        self.registers(&mut encoder, &drives)?;
        self.modbus(&mut encoder)?;
        self.beside_lines(&mut encoder)
    }
}

impl MetricsScrape {
    /// The polled registers of all drives, as far as they are fresh.
    fn registers(
        &self,
        encoder: &mut DescriptorEncoder<'_>,
        drives: &[(&SharedDrive, Arc<DriveView>)],
    ) -> fmt::Result {
        let ages = drives
            .iter()
            .filter_map(|(drive, view)| Some((labels(drive), age(drive, view, self.now)?)));
        gauges(encoder, &table::VALUE_AGE, ages)?;
        let warns = drives.iter().filter_map(|(drive, view)| {
            let warns = shown::warns(&drive.description, view, self.now)?;
            Some((labels(drive), f64::from(u8::from(warns))))
        });
        gauges(encoder, &table::WARNING, warns)?;
        let fresh = || {
            drives
                .iter()
                .flat_map(|(drive, view)| fresh(drive, view, self.now))
        };
        let is_output = |register: &Register| register.role == Some(RegisterRole::OutputFrequency);
        let output = fresh().filter(|(_, register, _)| is_output(register));
        gauges(
            encoder,
            &table::OUTPUT_FREQUENCY,
            output.map(|(drive, _, value)| (labels(drive), value)),
        )?;
        let others = fresh().filter(|(_, register, _)| !is_output(register));
        gauges(
            encoder,
            &table::VALUE,
            others.map(|(drive, register, value)| {
                let more = [
                    ("name", register.name.as_str()),
                    ("unit", register.unit.symbol()),
                ];
                ([labels(drive), more.to_vec()].concat(), value)
            }),
        )
    }

    /// How the lines see their drives.
    fn stations(&self, encoder: &mut DescriptorEncoder<'_>, shared: &SharedPlant) -> fmt::Result {
        let stations: Vec<_> = shared
            .drives
            .iter()
            .map(|it| (it.as_ref(), it.station.load_full()))
            .collect();
        each(encoder, table::STATION, || {
            stations
                .iter()
                .map(|(drive, station)| (labels(drive), station.as_ref()))
        })?;
        let replies = || {
            stations.iter().flat_map(|(drive, station)| {
                let classes = REPLY_CLASSES.into_iter().zip(&station.replies);
                classes
                    .map(|(class, reply)| ([labels(drive), vec![("class", class)]].concat(), reply))
            })
        };
        each(encoder, table::REPLIES, replies)?;
        let known = replies().filter(|(_, reply)| reply.count > 0);
        let times = known.flat_map(|(labels, reply)| {
            table::QUANTILES.into_iter().map(move |(share, time)| {
                (
                    [labels.as_slice(), &[("share", share)]].concat(),
                    time(reply).as_secs_f64(),
                )
            })
        });
        gauges(encoder, &table::REPLY_TIME, times)?;
        let unit = unit(&table::REPLY);
        let mut family = begin(encoder, &table::REPLY, unit.as_ref())?;
        for (drive, station) in &stations {
            for (class, counts) in REPLY_CLASSES.into_iter().zip(&station.reply_counts) {
                histogram(
                    &mut family,
                    &[labels(drive), vec![("class", class)]].concat(),
                    counts,
                )?;
            }
        }
        let mut family = begin(encoder, &table::COMMANDS, None)?;
        for (drive, station) in &stations {
            for (source, outcome, count) in station.commands.iter() {
                let more = vec![("source", source), ("outcome", outcome.keyword())];
                sample(
                    &mut family,
                    &[labels(drive), more].concat(),
                    MetricValue::Count(count),
                )?;
            }
        }
        Ok(())
    }

    /// The Modbus servers, TCP and serial, and what was read of them.
    fn modbus(&self, encoder: &mut DescriptorEncoder<'_>) -> fmt::Result {
        each(encoder, table::MODBUS, || {
            [(Vec::new(), self.state.modbus.as_ref())]
        })?;
        let serial = self.state.modbus.serial().all();
        each(encoder, table::SERIAL, || {
            serial
                .iter()
                .map(|it| (vec![("master", it.master())], it.as_ref()))
        })?;
        let reads = self.state.modbus.reads().all();
        each(encoder, table::READS, || {
            reads
                .iter()
                .map(|it| (vec![("listener", it.listener())], it.as_ref()))
        })?;
        self.exceptions(encoder)
    }

    /// The brokers, the local socket and the journal.
    fn beside_lines(&self, encoder: &mut DescriptorEncoder<'_>) -> fmt::Result {
        if let Some(mqtt) = self.state.mqtt.load().as_ref() {
            each(encoder, table::MQTT, || [(Vec::new(), mqtt.as_ref())])?;
        }
        if let Some(sparkplug) = self.state.sparkplug.load().as_ref() {
            each(encoder, table::SPARKPLUG, || {
                [(Vec::new(), sparkplug.as_ref())]
            })?;
        }
        if let Some(socket) = &self.state.socket {
            each(encoder, table::SOCKET, || [(Vec::new(), socket.as_ref())])?;
        }
        if let Some(report) = self.state.journal.as_ref().map(|journal| journal.report()) {
            each(encoder, table::JOURNAL, || [(Vec::new(), &report)])?;
        }
        Ok(())
    }

    fn exceptions(&self, encoder: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let mut family = begin(encoder, &table::MODBUS_EXCEPTIONS, None)?;
        for (code, count) in self.state.modbus.counters().exceptions.iter().enumerate() {
            let code = if code == 0 {
                "other".to_owned()
            } else {
                format!("{code:02X}")
            };
            sample(
                &mut family,
                &vec![("code", code.as_str())],
                MetricValue::Count(*count),
            )?;
        }
        Ok(())
    }
}

/// The age of the oldest fast value of `drive`; `None` while one was never read.
fn age(drive: &SharedDrive, view: &DriveView, now: MonoTime) -> Option<f64> {
    let fast = drive
        .description
        .model
        .registers
        .iter()
        .filter(|register| register.poll == Some(PollClass::Fast));
    let ages = fast.map(|register| Some(now.since(view.snapshot.read_at(register)?)));
    let oldest = ages.collect::<Option<Vec<_>>>()?.into_iter().max()?;
    Some(oldest.as_secs_f64())
}

/// The registers of `drive` whose last reading is not stale, with their values.
fn fresh<'a>(
    drive: &'a SharedDrive,
    view: &DriveView,
    now: MonoTime,
) -> impl Iterator<Item = (&'a SharedDrive, &'a Register, f64)> {
    let description = &drive.description;
    description
        .model
        .registers
        .iter()
        .filter_map(move |register| {
            let reading = description.fresh(register, &view.snapshot, now)?;
            Some((drive, register, reading.value.value()))
        })
}

fn labels(drive: &SharedDrive) -> Labels<'_> {
    vec![
        ("line", drive.description.line.as_str()),
        ("drive", drive.description.name.as_str()),
    ]
}

/// Each metric of `metrics` with a sample of each of `sources`.
fn each<'a, T: 'a, I>(
    encoder: &mut DescriptorEncoder<'_>,
    metrics: &[MetricFamily<T>],
    sources: impl Fn() -> I,
) -> fmt::Result
where
    I: IntoIterator<Item = (Labels<'a>, &'a T)>,
{
    for metric in metrics {
        let unit = unit(&metric.name);
        let mut family = begin(encoder, &metric.name, unit.as_ref())?;
        for (labels, source) in sources() {
            let value = match metric.sample {
                MetricSample::Counter(take) => take(source).map(MetricValue::Count),
                MetricSample::Sum(take) => take(source).map(MetricValue::Sum),
                MetricSample::Gauge(take) => take(source).map(MetricValue::Level),
                MetricSample::Flag(take) => {
                    take(source).map(|is_set| MetricValue::Level(f64::from(u8::from(is_set))))
                }
            };
            value.map_or(Ok(()), |value| sample(&mut family, &labels, value))?;
        }
    }
    Ok(())
}

/// One metric with the samples `values`.
fn gauges<'a>(
    encoder: &mut DescriptorEncoder<'_>,
    name: &MetricName,
    values: impl IntoIterator<Item = (Labels<'a>, f64)>,
) -> fmt::Result {
    let unit = unit(name);
    let mut family = begin(encoder, name, unit.as_ref())?;
    for (labels, value) in values {
        sample(&mut family, &labels, MetricValue::Level(value))?;
    }
    Ok(())
}

fn begin<'e>(
    encoder: &'e mut DescriptorEncoder<'_>,
    name: &'e MetricName,
    unit: Option<&'e Unit>,
) -> Result<MetricEncoder<'e>, fmt::Error> {
    encoder.encode_descriptor(name.name, name.help, unit, name.kind)
}

fn unit(name: &MetricName) -> Option<Unit> {
    name.unit.map(|unit| Unit::Other(unit.to_owned()))
}

#[derive(Clone, Copy)]
enum MetricValue {
    Count(u64),
    Sum(f64),
    Level(f64),
}

fn sample(family: &mut MetricEncoder<'_>, labels: &Labels<'_>, value: MetricValue) -> fmt::Result {
    // Without labels no braces are written: some parsers reject empty ones.
    if labels.is_empty() {
        write(family, value)
    } else {
        write(&mut family.encode_family(labels)?, value)
    }
}

fn write(encoder: &mut MetricEncoder<'_>, value: MetricValue) -> fmt::Result {
    match value {
        MetricValue::Count(count) => encoder.encode_counter::<NoLabelSet, u64, u64>(&count, None),
        MetricValue::Sum(sum) => encoder.encode_counter::<NoLabelSet, f64, u64>(&sum, None),
        MetricValue::Level(level) => encoder.encode_gauge(&level),
    }
}

/// Reply times of one class, if there were any.
fn histogram(
    family: &mut MetricEncoder<'_>,
    labels: &Labels<'_>,
    counts: &ReplyCounts,
) -> fmt::Result {
    let count = counts.count();
    if count == 0 {
        return Ok(());
    }
    let end = |end: Option<Duration>| end.map_or(f64::INFINITY, |end| end.as_secs_f64());
    let buckets: Vec<_> = counts
        .buckets()
        .map(|(until, count)| (end(until), count))
        .collect();
    let mut encoder = family.encode_family(labels)?;
    encoder.encode_histogram::<NoLabelSet>(counts.sum().as_secs_f64(), count, &buckets, None)
}

/// The metrics in `text` in the older text format of Prometheus: a counter is described by the name of its samples, and
/// there are neither units nor an end mark.
pub(super) fn older(text: &str) -> String {
    let counters: HashSet<_> = text
        .lines()
        .filter_map(|line| line.strip_prefix("# TYPE ")?.strip_suffix(" counter"))
        .collect();
    let mut older = String::with_capacity(text.len());
    for line in text
        .lines()
        .filter(|line| !line.starts_with("# UNIT ") && *line != "# EOF")
    {
        let mut words = line.splitn(4, ' ');
        match (words.next(), words.next(), words.next(), words.next()) {
            (Some("#"), Some(what), Some(name), Some(rest)) if counters.contains(name) => {
                older.extend(["# ", what, " ", name, "_total ", rest]);
            }
            _ => older.push_str(line),
        }
        older.push('\n');
    }
    older
}
