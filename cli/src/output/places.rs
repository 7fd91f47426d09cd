//! Which folder each photo's result goes to: named like the photo, numbered where that is another photo's.
use super::names;
use super::owner::{self, Holds, Source};
use std::collections::{HashMap, HashSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A photo and the folder of its result.
#[derive(Debug)]
pub(crate) struct Place {
    pub(crate) photo: PathBuf,
    /// Name of the folder.
    pub(crate) name: String,
    /// The photo's file, as far as it had to be read.
    source: Option<Source>,
    /// Whose result was in the way of a better name.
    pub(crate) in_the_way: Vec<String>,
}

impl Place {
    /// The photo's file.
    pub(crate) fn source(&mut self) -> io::Result<&Source> {
        let source = self.source.take().map_or_else(|| Source::of(&self.photo), Ok)?;
        Ok(self.source.insert(source))
    }
}

/// The names in a folder of results.
#[derive(Debug)]
pub(crate) struct Places {
    out: PathBuf,
    limit: usize,
    /// Folded names that this run has given away.
    taken: HashSet<String>,
}

impl Places {
    /// The places in the folder `out`.
    pub(crate) fn new(out: &Path) -> Self {
        Self { out: out.to_owned(), limit: names::limit(out), taken: HashSet::new() }
    }

    /// A place for each of `photos`, in their order.
    pub(crate) fn plan(&mut self, photos: &[PathBuf]) -> Vec<Place> {
        let there = self.there();
        photos.iter().map(|photo| self.choose(photo, None, &there)).collect()
    }

    /// Another name for a place that another process has taken.
    pub(crate) fn change(&mut self, place: &mut Place) {
        let there = self.there();
        *place = self.choose(&place.photo, place.source.take(), &there);
    }

    /// What is in the folder, by folded names.
    fn there(&self) -> HashMap<String, Vec<String>> {
        let mut there: HashMap<String, Vec<String>> = HashMap::new();
        for entry in fs::read_dir(&self.out).into_iter().flatten().flatten() {
            // Names that are no text are none of ours, nor in the way of one.
            if let Ok(name) = entry.file_name().into_string() {
                there.entry(names::fold(&name)).or_default().push(name);
            }
        }
        there
    }

    fn choose(
        &mut self,
        photo: &Path,
        source: Option<Source>,
        there: &HashMap<String, Vec<String>>,
    ) -> Place {
        let stem = names::safe(photo.file_stem().unwrap_or_default(), self.limit);
        let mut place = Place { photo: photo.to_owned(), name: stem.clone(), source, in_the_way: Vec::new() };
        for count in 1.. {
            let candidate = names::numbered(&stem, count);
            let key = names::fold(&candidate);
            if self.taken.contains(&key) {
                continue;
            }
            let Some(name) = self.free(candidate, there.get(&key), &mut place) else { continue };
            self.taken.insert(key);
            place.name = name;
            break;
        }
        place
    }

    /// The name under which `candidate` can be used, given the names that are there and differ from it by case at
    /// most.
    fn free(&self, candidate: String, there: Option<&Vec<String>>, place: &mut Place) -> Option<String> {
        let mut others = Vec::new();
        for name in there.into_iter().flatten() {
            let mut hash = || place.source().ok().map(|source| source.sha256.clone());
            match owner::holds(&self.out.join(name), &mut hash) {
                Holds::This => return Some(name.clone()),
                Holds::Nothing if *name == candidate => {}
                Holds::Nothing => others.push(format!("{} is there", self.out.join(name).display())),
                Holds::Other(photo) => {
                    let folder = self.out.join(name);
                    let of = photo.map_or_else(
                        || "a result that no report assigns to a photo".to_owned(),
                        |photo| format!("the result of {photo}"),
                    );
                    others.push(format!("{} holds {of}", folder.display()));
                }
            }
        }
        if others.is_empty() {
            return Some(candidate);
        }
        place.in_the_way.append(&mut others);
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_of_one_name_get_folders_of_their_own() {
        let mut places = Places::new(Path::new("no such folder"));
        let photos =
            ["a/x.jpg", "b/x.png", "x-2.jpg", "y", "x", "X.jpg", "...jpg", "..jpg"].map(PathBuf::from);
        let names: Vec<_> = places.plan(&photos).into_iter().map(|p| p.name).collect();
        assert_eq!(names, ["x", "x-2", "x-2-2", "y", "x-3", "X-4", "photo", "photo-2"]);
    }
}
