//! Sparkplug B payloads: the fields of the published schema that are used here, and no others.
//!
//! Everything else (data sets, templates, files, metadata) is skipped on receipt, and never sent.

use prost::Message;

/// The largest payload of a command that is read: many times the largest command. Decoded, it takes some fifty times as
/// much memory.
pub const COMMAND_MAX_BYTES: usize = 8 * 1024;

/// One message.
#[derive(Clone, PartialEq, prost::Message)]
pub struct SparkplugPayload {
    /// When it was sent, in milliseconds since 1970 (UTC).
    #[prost(uint64, optional, tag = "1")]
    pub timestamp: Option<u64>,
    /// Its values or orders.
    #[prost(message, repeated, tag = "2")]
    pub metrics: Vec<PayloadMetric>,
    /// Its number among the messages of its edge node, 0 to 255; commands and NDEATH have none.
    #[prost(uint64, optional, tag = "3")]
    pub seq: Option<u64>,
}

/// One value of a message.
#[derive(Clone, PartialEq, prost::Message)]
pub struct PayloadMetric {
    /// Its name; always present in births.
    #[prost(string, optional, tag = "1")]
    pub name: Option<String>,
    /// The number that replaces the name after the birth.
    #[prost(uint64, optional, tag = "2")]
    pub alias: Option<u64>,
    /// When it had this value, in milliseconds since 1970 (UTC).
    #[prost(uint64, optional, tag = "3")]
    pub timestamp: Option<u64>,
    /// The number of a [`PayloadType`].
    #[prost(uint32, optional, tag = "4")]
    pub datatype: Option<u32>,
    /// It is historical, and says nothing about the present.
    #[prost(bool, optional, tag = "5")]
    pub is_historical: Option<bool>,
    /// There is no value.
    #[prost(bool, optional, tag = "7")]
    pub is_null: Option<bool>,
    /// Unit, limits, quality and the like.
    #[prost(message, optional, tag = "9")]
    pub properties: Option<PropertySet>,
    /// The value.
    #[prost(oneof = "PayloadValue", tags = "10, 11, 12, 13, 14, 15")]
    pub value: Option<PayloadValue>,
}

/// A value as sent. Signed numbers are sent as their bits.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum PayloadValue {
    /// Integers of up to 32 bits.
    #[prost(uint32, tag = "10")]
    Int(u32),
    /// Integers of 64 bits, and moments.
    #[prost(uint64, tag = "11")]
    Long(u64),
    /// Single precision.
    #[prost(float, tag = "12")]
    Float(f32),
    /// Double precision.
    #[prost(double, tag = "13")]
    Double(f64),
    /// True or false.
    #[prost(bool, tag = "14")]
    Boolean(bool),
    /// Text.
    #[prost(string, tag = "15")]
    Text(String),
}

/// Properties: keys, and the same number of values in the same order.
#[derive(Clone, PartialEq, prost::Message)]
pub struct PropertySet {
    /// The keys.
    #[prost(string, repeated, tag = "1")]
    pub keys: Vec<String>,
    /// The values.
    #[prost(message, repeated, tag = "2")]
    pub values: Vec<PropertyValue>,
}

impl PropertySet {
    /// With one more property.
    #[must_use]
    pub fn with(mut self, key: &str, datatype: PayloadType, value: PropertyScalar) -> Self {
        self.keys.push(key.to_owned());
        self.values.push(PropertyValue {
            datatype: Some(datatype as u32),
            value: Some(value),
        });
        self
    }

    /// `None` for a set without any.
    #[must_use]
    pub fn or_none(self) -> Option<Self> {
        (!self.keys.is_empty()).then_some(self)
    }
}

/// The value of a property.
#[derive(Clone, PartialEq, prost::Message)]
pub struct PropertyValue {
    /// The number of a [`PayloadType`].
    #[prost(uint32, optional, tag = "1")]
    pub datatype: Option<u32>,
    /// The value.
    #[prost(oneof = "PropertyScalar", tags = "3, 5, 6, 7, 8")]
    pub value: Option<PropertyScalar>,
}

/// A value of a property as sent.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum PropertyScalar {
    /// Integers of up to 32 bits.
    #[prost(uint32, tag = "3")]
    Int(u32),
    /// Single precision.
    #[prost(float, tag = "5")]
    Float(f32),
    /// Double precision.
    #[prost(double, tag = "6")]
    Double(f64),
    /// True or false.
    #[prost(bool, tag = "7")]
    Boolean(bool),
    /// Text.
    #[prost(string, tag = "8")]
    Text(String),
}

/// Types of values, by their numbers in the specification.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum PayloadType {
    /// Signed, 32 bits.
    Int32 = 3,
    /// Signed, 64 bits.
    Int64 = 4,
    /// Double precision.
    Double = 10,
    /// True or false.
    Boolean = 11,
    /// Text.
    Text = 12,
}

/// How reliable a value is: the property `PayloadQuality`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum PayloadQuality {
    /// It is valid.
    Good = 192,
    /// It is older than allowed, or was never read.
    Stale = 500,
}

impl SparkplugPayload {
    /// The payload of a command in `bytes`.
    ///
    /// # Errors
    /// There are too many bytes, or they do not match the schema: why, for people.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        if bytes.len() > COMMAND_MAX_BYTES {
            return Err(format!(
                "{} bytes are more than any command needs; at most {COMMAND_MAX_BYTES} are read",
                bytes.len()
            ));
        }
        Self::parse(bytes)
    }

    /// The payload in `bytes`, of any length, as hosts get it.
    ///
    /// # Errors
    /// They do not match the schema: why, for people.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        Self::decode(bytes).map_err(|error| format!("no Sparkplug B payload ({error})"))
    }

    /// Its bytes.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        self.encode_to_vec()
    }
}

impl PayloadValue {
    /// A signed integer of 64 bits.
    #[must_use]
    pub const fn of_i64(number: i64) -> Self {
        Self::Long(number.cast_unsigned())
    }

    /// A signed integer of 32 bits.
    #[must_use]
    pub const fn of_i32(number: i32) -> Self {
        Self::Int(number.cast_unsigned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        let properties = PropertySet::default().with(
            "engUnit",
            PayloadType::Text,
            PropertyScalar::Text("Hz".into()),
        );
        let values = [
            PayloadValue::of_i32(-2),
            PayloadValue::of_i64(-3),
            PayloadValue::Float(1.5),
            PayloadValue::Double(42.5),
            PayloadValue::Boolean(true),
            PayloadValue::Text("forward".into()),
        ];
        let metric = |value| PayloadMetric {
            name: Some("run/set".into()),
            alias: Some(7),
            timestamp: Some(1_767_225_600_000),
            datatype: Some(PayloadType::Text as u32),
            is_historical: Some(true),
            is_null: None,
            properties: properties.clone().or_none(),
            value: Some(value),
        };
        let payload = SparkplugPayload {
            timestamp: Some(1_767_225_600_001),
            metrics: values.into_iter().map(metric).collect(),
            seq: Some(255),
        };
        assert_eq!(SparkplugPayload::read(&payload.bytes()), Ok(payload));
    }

    /// tck-id-payloads-metric-datatype-value, tck-id-payloads-propertyset-quality-value-value.
    #[test]
    fn types_and_qualities_have_the_numbers_of_the_specification() {
        let types = [
            PayloadType::Int32,
            PayloadType::Int64,
            PayloadType::Double,
            PayloadType::Boolean,
            PayloadType::Text,
        ];
        assert_eq!(types.map(|it| it as u32), [3, 4, 10, 11, 12]);
        assert_eq!(
            [PayloadQuality::Good, PayloadQuality::Stale].map(|it| it as u32),
            [192, 500]
        );
    }

    #[test]
    fn fields_that_are_not_used_are_skipped() {
        // uuid (4) and body (5) of the payload, a data set (17) as the value of its metric.
        let bytes = [
            0x22, 1, b'u', 0x2A, 2, 1, 2, 0x12, 6, 0x0A, 1, b'a', 0x8A, 0x01, 0,
        ];
        let read = SparkplugPayload::read(&bytes).unwrap();
        assert_eq!(
            (read.metrics.len(), read.metrics[0].name.as_deref()),
            (1, Some("a"))
        );
        assert_eq!(read.metrics[0].value, None);
    }

    #[test]
    fn what_is_no_payload_is_refused_in_words() {
        let refused = SparkplugPayload::read(b"stop").unwrap_err();
        assert!(refused.starts_with("no Sparkplug B payload ("), "{refused}");
        let long = SparkplugPayload::read(&vec![0; COMMAND_MAX_BYTES + 1]).unwrap_err();
        assert!(long.contains(&COMMAND_MAX_BYTES.to_string()), "{long}");
    }
}
