//! The rated values of a drive, and what it measures at an output frequency.

use crate::sim::motor::MICROHERTZ;
use crate::sim::options::DriveOptions;

/// Millionths in a unit of measure: readings are whole numbers of them.
pub(super) const MICRO: i64 = 1_000_000;

/// The rated values of one drive, in millionths of their units.
#[derive(Clone, Copy, Debug)]
pub(super) struct SimRatings {
    full_scale: i64,
    current: i64,
    voltage: i64,
    dc_link: i64,
}

impl SimRatings {
    pub(super) fn of(options: &DriveOptions) -> Self {
        Self {
            full_scale: i64::from(options.max_frequency_hz.max(1)) * MICROHERTZ,
            current: i64::from(options.rated_current_x10) * MICRO / 10,
            voltage: i64::from(options.rated_voltage_v) * MICRO,
            dc_link: i64::from(options.dc_link_v) * MICRO,
        }
    }

    /// The frequency, in microhertz, that the ramps refer to.
    pub(super) const fn full_scale(&self) -> i64 {
        self.full_scale
    }

    pub(super) const fn rated_current(&self) -> i64 {
        self.current
    }

    pub(super) const fn rated_voltage(&self) -> i64 {
        self.voltage
    }

    pub(super) const fn rated_power(&self) -> i64 {
        power(self.current, self.voltage)
    }

    /// `whole` in proportion to the speed.
    pub(super) const fn share(&self, whole: i64, output: i64) -> i64 {
        // Both are some hundred millions at most, so that the product fits.
        whole * (output.abs() / 10) / (self.full_scale / 10)
    }

    /// Magnetising the motor takes a third of the rated current.
    pub(super) const fn current(&self, output: i64) -> i64 {
        if output == 0 {
            0
        } else {
            self.current / 100 * 33 + self.share(self.current / 100 * 67, output)
        }
    }

    /// In proportion to the frequency.
    pub(super) const fn voltage(&self, output: i64) -> i64 {
        self.share(self.voltage, output)
    }

    /// The rectified supply, which gives way by 20 V at full speed.
    pub(super) const fn dc_link(&self, output: i64) -> i64 {
        self.dc_link - self.share(20 * MICRO, output)
    }

    pub(super) const fn power(&self, output: i64) -> i64 {
        power(self.current(output), self.voltage(output))
    }
}

/// The power of three phases at a power factor of about 0.87, in millionths of a kilowatt.
const fn power(current: i64, voltage: i64) -> i64 {
    current / 1_000 * (voltage / 1_000) / 1_000 * 15 / 10
}
