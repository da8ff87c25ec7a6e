//! Whatever happens to a line in whatever order, its promises hold. The observer that checks them is the fuzzer's; here it
//! gets random events in every run of the tests.

use crate::fuzz_targets::line;
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_request_ends_once_whatever_happens(
        flags in any::<u8>(),
        model in any::<u8>(),
        events in prop::collection::vec(any::<u8>(), 1..1_200),
    ) {
        line::run(&[vec![flags, model], events].concat());
    }
}
