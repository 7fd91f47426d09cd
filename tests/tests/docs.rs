//! The documents: no page is missing from its index, no link is broken, figures are quoted rightly, and the code that the
//! README shows is code that the tests compile.
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Columns of a line of Markdown; tables, code and lines with a link are exempt.
const COLUMNS: usize = 120;
/// Names of files in this repository end so; other endings may be those of files that the programs write.
const SOURCES: [&str; 10] = ["rs", "py", "sh", "toml", "java", "kt", "swift", "c", "h", "lock"];
/// Each decision's sections, in this order.
const SECTIONS: [&str; 5] = ["Question", "Setup", "Result", "Decision", "Status"];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// What is built, fetched or written, not the project's own.
fn is_skipped(folder: &Path) -> bool {
    let name = folder.file_name().expect("a name").to_string_lossy().into_owned();
    ["target", "node_modules", "runs", "out"].contains(&&*name)
        || name.starts_with('.')
        || name.starts_with("target-")
}

/// Markdown files below `folder` that belong to the project.
fn markdown(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() && !is_skipped(&path) {
            markdown(&path, found);
        } else if path.extension().is_some_and(|e| e == "md") {
            found.push(path);
        }
    }
}

fn pages() -> Vec<PathBuf> {
    let mut found = Vec::new();
    markdown(&root(), &mut found);
    assert!(found.len() > 10, "{found:?}");
    found
}

/// Lines with their number, and whether they are code.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str, bool)> {
    let mut fenced = false;
    text.lines().enumerate().map(move |(i, line)| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        (i + 1, line, fenced || fence)
    })
}

#[test]
fn every_decision_is_listed_and_has_its_sections() {
    let folder = root().join("docs/decisions");
    let index = read(&folder.join("README.md"));
    let mut numbers = BTreeSet::new();
    for path in pages().iter().filter(|p| p.parent() == Some(&folder) && !p.ends_with("README.md")) {
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        let text = read(path);
        let title = text.lines().next().unwrap_or_default();
        let (number, title) = title
            .strip_prefix("# ")
            .and_then(|t| t.split_once(": "))
            .unwrap_or_else(|| panic!("{name}: first line"));
        assert!(name.starts_with(&format!("{number}-")), "{name} is headed {number}");
        assert!(numbers.insert(number.to_owned()), "{number} twice");
        assert!(index.contains(&format!("| [{number}]({name}) | {title} |")), "{name} is not in the index");
        let heads: Vec<_> = text.lines().filter_map(|line| line.strip_prefix("## ")).collect();
        assert_eq!(heads, SECTIONS, "{name}");
        let status = text.split("## Status\n\n").nth(1).unwrap_or_default();
        let known = ["Adopted", "Rejected", "Superseded by ["];
        assert!(known.iter().any(|word| status.starts_with(word)), "{name}: status {status:?}");
    }
    assert_eq!(index.matches("\n| [").count(), numbers.len(), "a row of the index without its page");
}

#[test]
fn links_lead_to_files() {
    for page in pages() {
        for (number, line, code) in lines(&read(&page)) {
            if code {
                continue;
            }
            for part in line.split("](").skip(1) {
                let target = part.split([')', '#', ' ']).next().unwrap_or_default();
                if target.is_empty() || target.contains("://") || target.starts_with("mailto:") {
                    continue;
                }
                let place = page.parent().expect("a folder").join(target);
                assert!(place.exists(), "{}:{number}: {target} is not there", page.display());
            }
        }
    }
}

#[test]
fn a_model_carries_the_card_beside_it() {
    for card in pages().iter().filter(|page| page.parent() == Some(&root().join("models"))) {
        let model = fs::read(card.with_extension("fmat")).expect("each card's model");
        let word = |at: usize| -> usize {
            let bytes: [u8; 8] = model[at..at + 8].try_into().expect("eight bytes");
            usize::try_from(u64::from_le_bytes(bytes)).expect("within the file")
        };
        // docs/model-format.md: the table's rows of 32 bytes begin at 64 with four letters.
        let row = (64..).step_by(32).find(|&row| &model[row..row + 4] == b"CARD").expect("a card");
        let (start, length) = (word(row + 8), word(row + 16));
        let same = read(card).as_bytes() == &model[start..start + length];
        assert!(
            same,
            "{}: not what the model carries; run tools/card.py and tools/results.py",
            card.display()
        );
    }
}

#[test]
fn figures_are_those_of_the_results() {
    let results = read(&root().join("docs/results.md"));
    for page in ["README.md", "models/phone.md"] {
        let text = read(&root().join(page));
        let mut quoted = 0;
        for line in text
            .lines()
            .filter(|line| line.starts_with("| ") && (line.contains("MiB |") || line.contains('°')))
        {
            assert!(results.contains(line), "{page}: docs/results.md has other figures than {line}");
            quoted += 1;
        }
        assert!(quoted > 1, "{page} quotes nothing");
    }
}

#[test]
fn code_of_the_readme_is_code_that_is_compiled() {
    let homes = [
        ("rust", "core/examples/readme.rs"),
        ("c", "examples/c/readme.c"),
        ("kotlin", "android/flashmat/src/hostTest/kotlin/com/flashmat/ReadmeTest.kt"),
        ("swift", "ios/Tests/FlashmatTests/ReadmeTests.swift"),
    ];
    let readme = read(&root().join("README.md"));
    for (language, home) in homes {
        let fence = format!("\n```{language}\n");
        let mut blocks = readme.split(&fence).skip(1);
        let block = blocks.next().and_then(|rest| rest.split("```").next()).expect(language);
        assert!(block.lines().count() >= 5, "{language}: {block}");
        assert!(blocks.next().is_none(), "{language}: a second block, which no test compiles");
        assert!(
            read(&root().join(home)).contains(block),
            "{home} does not have the README's lines:\n{block}"
        );
    }
    for command in ["cargo run --release -p flashmat -- capture samples/leather.jpg", "`./ci.sh`"] {
        assert!(readme.contains(command), "the README must have the command {command}");
    }
}

#[test]
fn lines_of_markdown_are_short() {
    let mut long = Vec::new();
    for page in pages() {
        for (number, line, code) in lines(&read(&page)) {
            let exempt = code || line.trim_start().starts_with('|') || line.contains("](");
            if !exempt && line.chars().count() > COLUMNS {
                long.push(format!("{}:{number}", page.display()));
            }
        }
    }
    assert!(long.is_empty(), "more than {COLUMNS} columns: {long:#?}");
}

/// Every file of the project, as its path from the root.
fn files(folder: &Path, found: &mut Vec<String>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            if !is_skipped(&path) {
                files(&path, found);
            }
        } else {
            found.push(path.to_string_lossy().replace('\\', "/"));
        }
    }
}

#[test]
fn files_that_are_named_are_there() {
    let mut all = Vec::new();
    files(&root(), &mut all);
    let mut gone = Vec::new();
    // What a decision names was there at its commit.
    for page in pages().iter().filter(|page| !page.starts_with(root().join("docs/decisions"))) {
        for (number, line, code) in lines(&read(page)) {
            for name in line.split('`').skip(1).step_by(2).filter(|_| !code) {
                let ending = name.rsplit_once('.').map_or("", |(_, ending)| ending);
                let plain = name.chars().all(|c| c.is_ascii_alphanumeric() || "._-/+".contains(c));
                if !plain || !SOURCES.contains(&ending) || name.starts_with('.') {
                    continue;
                }
                let end = format!("/{name}");
                if !all.iter().any(|file| file.ends_with(&end)) {
                    gone.push(format!("{}:{number}: {name}", page.display()));
                }
            }
        }
    }
    assert!(gone.is_empty(), "{gone:#?}");
}
