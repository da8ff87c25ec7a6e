//! The documents that a model's facts cite, and the confidence that each can support.

use super::Confidence;

/// A document that facts cite.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModelDocument {
    /// Its short name, as cited at the start of a source.
    pub name: String,
    /// Its full title.
    pub title: String,
    /// What it is.
    pub kind: DocumentKind,
    /// The models that it covers, by identifier or name. Empty: this very model.
    pub of: Vec<String>,
    /// The document that it was made from, if it is known: the two are no two sources.
    pub made_from: Option<String>,
}

/// What a document is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum DocumentKind {
    /// A manual of the vendor.
    Manual,
    /// A vendor's addition to a manual.
    Addendum,
    /// The manual of a company that sells the same drive under another name.
    DistributorManual,
    /// A program that talks to the drive.
    Program,
    /// A third party's list of registers.
    RegisterMap,
    /// Notes from one site.
    SiteNote,
    /// The settings used to commission drives at one site.
    CommissioningSheet,
    /// A public discussion.
    Forum,
}

impl DocumentKind {
    /// The word used in model files.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Manual => "manual",
            Self::Addendum => "addendum",
            Self::DistributorManual => "distributor-manual",
            Self::Program => "program",
            Self::RegisterMap => "register-map",
            Self::SiteNote => "site-note",
            Self::CommissioningSheet => "commissioning-sheet",
            Self::Forum => "forum",
        }
    }
}

impl ModelDocument {
    /// Whether it covers the model `id`.
    #[must_use]
    pub fn is_of(&self, id: &str) -> bool {
        self.of.is_empty() || self.of.iter().any(|of| of == id)
    }

    /// The highest confidence that this document supports for a fact of the model `id`.
    #[must_use]
    pub fn best(&self, id: &str) -> Confidence {
        if !self.is_of(id) {
            return Confidence::Sibling;
        }
        match self.kind {
            DocumentKind::Manual | DocumentKind::Addendum => Confidence::Manual,
            DocumentKind::DistributorManual => Confidence::SecondSource,
            DocumentKind::Program
            | DocumentKind::RegisterMap
            | DocumentKind::SiteNote
            | DocumentKind::CommissioningSheet
            | DocumentKind::Forum => Confidence::ThirdParty,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_manual_of_the_model_proves_anything() {
        let document = |kind, of: &[&str]| ModelDocument {
            name: "X".to_owned(),
            title: "X".to_owned(),
            kind,
            of: of.iter().map(|it| (*it).to_owned()).collect(),
            made_from: None,
        };
        for (kind, best) in [
            (DocumentKind::Manual, Confidence::Manual),
            (DocumentKind::Addendum, Confidence::Manual),
            (DocumentKind::DistributorManual, Confidence::SecondSource),
            (DocumentKind::Program, Confidence::ThirdParty),
            (DocumentKind::RegisterMap, Confidence::ThirdParty),
            (DocumentKind::SiteNote, Confidence::ThirdParty),
            (DocumentKind::CommissioningSheet, Confidence::ThirdParty),
            (DocumentKind::Forum, Confidence::ThirdParty),
        ] {
            assert_eq!(document(kind, &["acme-1", "acme-2"]).best("acme-1"), best);
            assert_eq!(
                document(kind, &[]).best("acme-1"),
                best,
                "without `of` it covers this very model"
            );
            assert_eq!(
                document(kind, &["acme-2"]).best("acme-1"),
                Confidence::Sibling
            );
        }
    }
}
