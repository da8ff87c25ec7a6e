//! Words that make a motor run when they are written to a drive's own register. Behind a gateway `write` does not know
//! the drive's model, so it checks every known one.

use crate::domain::command::Order;
use crate::drive::decode;
use crate::profile::catalog::Catalog;
use crate::profile::model::Model;

/// The models of `catalog` whose motor is started by `word` at `address`.
pub fn models_that_run(catalog: &Catalog, address: u16, word: u16) -> Vec<&str> {
    let runs = |id: &&str| catalog.find(id).is_some_and(|model| runs(model, address, word));
    catalog.ids().filter(runs).collect()
}

/// As the gateway decodes the word too.
fn runs(model: &Model, address: u16, word: u16) -> bool {
    matches!(decode::order(model, address.into(), &[word]), Ok(Order::Go(go)) if go.run().is_some())
}
