//! A source file as a tokenizer sees it.

use proc_macro2::{Delimiter, Group, Spacing, TokenStream, TokenTree};
use std::ops::Range;

/// What begins an item: a comma does not end it.
const ITEMS: [&str; 15] = [
    "pub", "fn", "mod", "use", "impl", "struct", "enum", "const", "static", "type", "trait",
    "unsafe", "async", "extern", "let",
];

/// A file and the views of it that the rules need.
pub struct Source {
    pub path: String,
    pub text: String,
    /// `text` with code that only tests see turned into spaces; its lines are those of `text`.
    pub shipped: String,
    /// Every path in code that ships, with its line, groups taken apart: `a::{b, c}` is `a::b` and `a::c`.
    pub paths: Vec<(usize, Vec<String>)>,
    /// The paths that it re-exports with `pub use`.
    pub exports: Vec<Vec<String>>,
    /// Every identifier and keyword with its line, tests included.
    pub words: Vec<(usize, String)>,
    /// Modules that it declares for tests only.
    pub test_modules: Vec<String>,
}

impl Source {
    pub fn new(path: &str, text: &str) -> Self {
        let tokens: TokenStream = text
            .parse()
            .unwrap_or_else(|error| panic!("{path}: {error}"));
        let mut reader = Reader::default();
        reader.read(&trees(tokens), false);
        let mut source = Self {
            path: path.to_owned(),
            text: text.to_owned(),
            shipped: text.to_owned(),
            paths: reader.paths,
            exports: reader.exports,
            words: reader.words,
            test_modules: reader.test_modules,
        };
        if reader.is_test {
            source.only_for_tests();
        }
        for span in reader.tests {
            source.shipped = blanked(&source.shipped, span);
        }
        source
    }

    /// Makes the whole file a test's.
    pub fn only_for_tests(&mut self) {
        self.shipped = blanked(&self.shipped, 0..self.shipped.len());
        self.paths.clear();
        self.exports.clear();
    }

    /// The modules from the crate's root to this file: `["line", "timing"]`.
    pub fn modules(&self) -> Vec<&str> {
        self.folder()
            .split('/')
            .skip_while(|part| *part != "src")
            .skip(1)
            .collect()
    }

    /// The folder in which the modules that this file declares stand: `crates/line/src/line/timing`.
    pub fn folder(&self) -> &str {
        let path = self.path.trim_end_matches(".rs");
        path.strip_suffix("/mod")
            .or_else(|| path.strip_suffix("/lib"))
            .unwrap_or(path)
    }

    pub fn room(&self) -> &str {
        self.modules().first().copied().unwrap_or("lib")
    }

    pub fn at(&self, line: usize, what: &str) -> String {
        format!("{}:{line}: {what}", self.path)
    }
}

#[derive(Default)]
struct Reader {
    /// The file as a whole is for tests.
    is_test: bool,
    tests: Vec<Range<usize>>,
    paths: Vec<(usize, Vec<String>)>,
    exports: Vec<Vec<String>>,
    words: Vec<(usize, String)>,
    test_modules: Vec<String>,
}

impl Reader {
    fn read(&mut self, trees: &[TokenTree], in_test: bool) {
        let mut at = 0;
        while at < trees.len() {
            let rest = &trees[at..];
            at += match rest {
                [mark, TokenTree::Group(group), ..]
                    if is_punct(mark, '#') && is_cfg_test(group) =>
                {
                    self.read_test(rest, in_test)
                }
                [mark, bang, TokenTree::Group(group), ..]
                    if is_punct(mark, '#') && is_punct(bang, '!') && is_cfg_test(group) =>
                {
                    self.is_test = true;
                    3
                }
                // A declaration uses nothing.
                [TokenTree::Ident(word), TokenTree::Ident(name), end, ..]
                    if word == "mod" && is_punct(end, ';') =>
                {
                    self.words
                        .push((name.span().start().line, name.to_string()));
                    3
                }
                [TokenTree::Ident(_), ..] => {
                    let exports = is_export(&trees[..at]);
                    self.read_path(rest, &[], in_test, exports)
                }
                [TokenTree::Group(group), ..] => {
                    self.read(&members(group), in_test);
                    1
                }
                _ => 1,
            };
        }
    }

    /// Reads what `#[cfg(test)]` marks; returns how many trees that is.
    fn read_test(&mut self, trees: &[TokenTree], in_test: bool) -> usize {
        let count = 2 + item(&trees[2..]);
        let last = &trees[count - 1];
        if !in_test {
            self.tests
                .push(trees[0].span().byte_range().start..last.span().byte_range().end);
        }
        let words: Vec<_> = trees[2..count].iter().map(ToString::to_string).collect();
        if let [.., keyword, name, end] = &words[..]
            && (keyword.as_str(), end.as_str()) == ("mod", ";")
        {
            self.test_modules.push(name.clone());
        }
        self.read(&trees[2..count], true);
        count
    }

    /// Reads the path that `trees` begins with and that continues `before`; returns how many trees that is.
    fn read_path(
        &mut self,
        trees: &[TokenTree],
        before: &[String],
        in_test: bool,
        exports: bool,
    ) -> usize {
        let TokenTree::Ident(word) = &trees[0] else {
            return 1;
        };
        let line = word.span().start().line;
        self.words.push((line, word.to_string()));
        let mut parts = before.to_vec();
        parts.push(word.to_string());
        match trees {
            [_, one, two, TokenTree::Ident(_), ..] if is_path_sign(one, two) => {
                3 + self.read_path(&trees[3..], &parts, in_test, exports)
            }
            [_, one, two, TokenTree::Group(group), ..]
                if is_path_sign(one, two) && group.delimiter() == Delimiter::Brace =>
            {
                let trees = members(group);
                let mut at = 0;
                while at < trees.len() {
                    at += self.read_path(&trees[at..], &parts, in_test, exports);
                }
                4
            }
            _ => {
                if exports && !in_test {
                    self.exports.push(parts.clone());
                }
                if !in_test {
                    self.paths.push((line, parts));
                }
                1
            }
        }
    }
}

fn trees(tokens: TokenStream) -> Vec<TokenTree> {
    tokens.into_iter().collect()
}

fn members(group: &Group) -> Vec<TokenTree> {
    trees(group.stream())
}

fn is_punct(tree: &TokenTree, sign: char) -> bool {
    matches!(tree, TokenTree::Punct(punct) if punct.as_char() == sign)
}

fn is_path_sign(one: &TokenTree, two: &TokenTree) -> bool {
    let is_joint = matches!(one, TokenTree::Punct(punct) if punct.spacing() == Spacing::Joint);
    is_joint && is_punct(one, ':') && is_punct(two, ':')
}

fn is_cfg_test(group: &Group) -> bool {
    group.delimiter() == Delimiter::Bracket
        && group.stream().to_string().replace(' ', "") == "cfg(test)"
}

/// Whether what follows is re-exported: `pub use`, `pub(crate) use`.
fn is_export(before: &[TokenTree]) -> bool {
    match before {
        [.., visibility, TokenTree::Group(_), word] | [.., visibility, word]
            if word.to_string() == "use" =>
        {
            visibility.to_string() == "pub"
        }
        _ => false,
    }
}

/// How many trees the item, variant or match arm has that `trees` begins with, its attributes included.
fn item(trees: &[TokenTree]) -> usize {
    let is_attribute = |at: &usize| is_punct(&trees[*at], '#');
    let begin = (0..trees.len())
        .step_by(2)
        .find(|at| !is_attribute(at))
        .unwrap_or(trees.len());
    let is_item = trees
        .get(begin)
        .is_some_and(|tree| ITEMS.contains(&tree.to_string().as_str()));
    for (at, tree) in trees.iter().enumerate().skip(begin) {
        let ends = match tree {
            // A pattern with braces is followed by `=>`.
            TokenTree::Group(group) => {
                group.delimiter() == Delimiter::Brace
                    && !trees.get(at + 1).is_some_and(|next| is_punct(next, '='))
            }
            _ => is_punct(tree, ';') || (is_punct(tree, ',') && !is_item),
        };
        if ends {
            return at + 1;
        }
    }
    trees.len()
}

/// `text` with spaces in `span`, and its line breaks kept.
fn blanked(text: &str, span: Range<usize>) -> String {
    let blank = text[span.clone()]
        .bytes()
        .map(|byte| if byte == b'\n' { '\n' } else { ' ' });
    format!(
        "{}{}{}",
        &text[..span.start],
        blank.collect::<String>(),
        &text[span.end..]
    )
}

#[test]
fn the_reader_of_sources_is_not_fooled() {
    let code = |text: &str| {
        Source::new("src/a.rs", text)
            .shipped
            .split_whitespace()
            .collect::<String>()
    };
    let arm = "match x {\n #[cfg(test)]\n (A, [v]) => Ok(B { c: 1 }),\n #[cfg(test)]\n B { c } => 1,\n _ => D,\n}";
    assert_eq!(code(arm), "matchx{_=>D,}");
    assert_eq!(
        code("#[cfg(test)]\n#[allow(x)]\nfn f<A, B>(a: A, b: B) { c() }\nfn g() {}"),
        "fng(){}"
    );
    assert_eq!(code("#![cfg(test)]\nfn g() {}"), "");
    let modules = |text| Source::new("src/a.rs", text).test_modules;
    assert_eq!(modules("#[cfg(test)]\nmod tests;\nmod other;"), ["tests"]);
    assert_eq!(
        modules("#[cfg(test)]\npub mod testing;\npub mod other;"),
        ["testing"]
    );
    let text = "// x::y\nuse a::{b, c::{self, d}};\nlet s = \"u::v\"; e::f(g!(h::i, 'x'))";
    let names: Vec<_> = Source::new("src/a.rs", text)
        .paths
        .into_iter()
        .map(|(_, path)| path.join("::"))
        .collect();
    assert_eq!(
        names,
        [
            "use",
            "a::b",
            "a::c::self",
            "a::c::d",
            "let",
            "s",
            "e::f",
            "g",
            "h::i"
        ]
    );
    let exports: Vec<_> = Source::new("src/a.rs", "pub(super) use a::{b, c};\nuse d::e;").exports;
    assert_eq!(exports, [["a", "b"], ["a", "c"]]);
}
