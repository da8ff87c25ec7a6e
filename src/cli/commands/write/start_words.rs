//! Words that make a motor run when they are written to a drive's own register. Behind a gateway `write` does not know
//! the drive's model, so it checks every known one.

use crate::domain::command::Order;
use crate::drive::decode;
use crate::profile::catalog::Catalog;
use crate::profile::model::{Model, OrderKind};

/// The models of `catalog` whose motor is started by `word` at `address`.
pub fn models_that_run(catalog: &Catalog, address: u16, word: u16) -> Vec<&str> {
    let runs = |id: &&str| {
        catalog
            .find(id)
            .is_some_and(|model| runs(model, address, word))
    };
    catalog.ids().filter(runs).collect()
}

/// Whether `word` runs the motor, as the gateway decodes it; a run word that says no direction runs the motor all the same.
fn runs(model: &Model, address: u16, word: u16) -> bool {
    let address = address.into();
    let is_decoded = || matches!(decode::order(model, address, &[word]), Ok(Order::Go(go)) if go.run().is_some());
    let runs = |kind| matches!(kind, OrderKind::Forward | OrderKind::Reverse);
    model
        .orders_at(address)
        .any(|(kind, fact)| runs(kind) && fact.value == word)
        || is_decoded()
}
