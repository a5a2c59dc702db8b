//! The page for browsers: the files of a folder, read at start and held in memory. Requests are looked up by name in this
//! table, so no path of a request reaches the file system.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use bytes::Bytes;
use hyper::header::HeaderValue;

/// Most files in the folder, with their compressed forms.
const MAX_FILES: usize = 256;
/// Most bytes of all files together.
const MAX_BYTES: u64 = 64 << 20;
/// Longest file name, in bytes.
const MAX_NAME_BYTES: usize = 128;
/// File that is served for `/` and for each scene.
const INDEX: &str = "index.html";
/// Element of [`INDEX`] whose content the server replaces by its description.
const PLACEHOLDER: &str = r#"<script type="application/json" id="lodestream-server">{}</script>"#;
/// Where the content `{}` ends in the placeholder.
const CONTENT_END: usize = PLACEHOLDER.len() - "</script>".len();
/// Hexadecimal digits of a content hash in a name, at least.
const HASH_DIGITS: usize = 8;

/// Why a folder cannot be served as the page.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The folder or a file cannot be read.
    #[error("cannot read {path}: {why}", path = .path.display())]
    Unreadable {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        why: io::Error,
    },
    /// The folder of the program is not known, beside which the page is.
    #[error("the program's folder is not known: {why}")]
    Program {
        /// The cause.
        why: io::Error,
    },
    /// There are too many files.
    #[error("{path} holds more than {MAX_FILES} files: give the folder that script/web has written", path = .0.display())]
    TooManyFiles(PathBuf),
    /// The files are too long.
    #[error("the files in {path} have more than {} MiB: give the folder that script/web has written", MAX_BYTES >> 20, path = .0.display())]
    TooLong(PathBuf),
    /// A name that cannot stand in an address as it is.
    #[error("{path} cannot be served: a name has 1 to {MAX_NAME_BYTES} letters, digits, dots, hyphens and underscores", path = .0.display())]
    Name(PathBuf),
    /// There is no index.html.
    #[error("{path} holds no {INDEX}: build the page with script/web", path = .0.display())]
    NoIndex(PathBuf),
    /// The index has not exactly one placeholder for the server's description.
    #[error("{path} must hold exactly one {PLACEHOLDER}, but holds {1}: build the page with script/web", path = .0.display())]
    Placeholder(PathBuf, usize),
    /// A compressed file without the file itself.
    #[error("{path} is the compressed form of a file that is missing: build the page with script/web", path = .0.display())]
    NoOriginal(PathBuf),
}

/// The page that a daemon serves on its HTTP port.
#[derive(Clone, Debug, Default)]
pub enum PageSetting {
    /// None: requests for it are answered as those of a client without WebSocket.
    #[default]
    Off,
    /// It was looked for in these folders, and is in none of them.
    Absent(Vec<PathBuf>),
    /// This one.
    Loaded(Page),
}

impl PageSetting {
    /// The page where a package or a build of the repository puts it: `../share/lodestream/web` or `../web` beside the
    /// program.
    ///
    /// # Errors
    /// A page that cannot be read, and a program whose folder is not known.
    pub fn installed() -> Result<Self, PageError> {
        let program = std::env::current_exe().map_err(|why| PageError::Program { why })?;
        let beside = |path: &str| program.parent().and_then(Path::parent).map(|parent| parent.join(path));
        let folders: Vec<PathBuf> = ["share/lodestream/web", "web"].into_iter().filter_map(beside).collect();
        match folders.iter().find(|folder| folder.is_dir()) {
            Some(folder) => Page::load(folder).map(Self::Loaded),
            None => Ok(Self::Absent(folders)),
        }
    }

    /// The sentence for people who look for the page, if it is absent.
    pub(crate) fn absence(&self) -> Option<String> {
        let Self::Absent(folders) = self else { return None };
        let folders: Vec<String> = folders.iter().map(|folder| folder.display().to_string()).collect();
        Some(format!(
            "the page for browsers is absent (looked in {}): build it with script/web",
            folders.join(" and ")
        ))
    }
}

/// Compression of a file's body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Coding {
    /// Brotli (RFC 7932).
    Brotli,
    /// gzip (RFC 1952).
    Gzip,
    /// None.
    Identity,
}

impl Coding {
    /// From the shortest result to the longest.
    pub(crate) const ALL: [Self; 3] = [Self::Brotli, Self::Gzip, Self::Identity];

    /// Name in `Accept-Encoding` and `Content-Encoding`.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Brotli => "br",
            Self::Gzip => "gzip",
            Self::Identity => "identity",
        }
    }

    /// Splits a file's name: the name of the file before compression, and its compression.
    fn of_name(name: &str) -> (&str, Self) {
        match name.rsplit_once('.') {
            Some((original, "br")) => (original, Self::Brotli),
            Some((original, "gz")) => (original, Self::Gzip),
            _ => (name, Self::Identity),
        }
    }
}

/// One file, with its compressed forms.
#[derive(Clone, Debug)]
pub(crate) struct Asset {
    pub(crate) content_type: &'static str,
    /// Whether the name has a content hash, so that the file never changes under it.
    pub(crate) immutable: bool,
    /// Contents and entity tags by compression; at least [`Coding::Identity`].
    pub(crate) forms: BTreeMap<Coding, (Bytes, HeaderValue)>,
}

/// The page's files.
#[derive(Clone, Debug)]
pub struct Page {
    /// The index before and after the server's description.
    index: (String, String),
    assets: BTreeMap<String, Asset>,
}

impl Page {
    /// Reads a folder: `index.html` with one element
    /// `<script type="application/json" id="lodestream-server">{}</script>`, other files, and beside each its compressed
    /// forms (`NAME.br`, `NAME.gz`). Folders in it and names that begin with a dot are ignored. At most 256 files and
    /// 64 MiB are read, and stay in memory.
    ///
    /// # Errors
    /// A file cannot be read, a limit is exceeded, a name needs encoding in an address, or `index.html` is missing or
    /// has no place for the server's description.
    pub fn load(folder: &Path) -> Result<Self, PageError> {
        let unreadable = |path: &Path| {
            let path = path.to_owned();
            move |why| PageError::Unreadable { path, why }
        };
        let mut files = BTreeMap::new();
        let mut left = MAX_BYTES;
        for entry in std::fs::read_dir(folder).map_err(unreadable(folder))? {
            let path = entry.map_err(unreadable(folder))?.path();
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_owned();
            if name.starts_with('.') || !path.metadata().map_err(unreadable(&path))?.is_file() {
                continue;
            }
            let plain = |byte: u8| byte.is_ascii_alphanumeric() || b".-_".contains(&byte);
            if name.is_empty() || name.len() > MAX_NAME_BYTES || !name.bytes().all(plain) {
                return Err(PageError::Name(path));
            }
            if files.len() == MAX_FILES {
                return Err(PageError::TooManyFiles(folder.to_owned()));
            }
            let mut contents = Vec::new();
            // One byte more than allowed shows that the file is too long.
            let mut file = File::open(&path).map_err(unreadable(&path))?.take(left + 1);
            file.read_to_end(&mut contents).map_err(unreadable(&path))?;
            left = left
                .checked_sub(contents.len() as u64)
                .ok_or_else(|| PageError::TooLong(folder.to_owned()))?;
            files.insert(name, contents);
        }
        Self::from_files(folder, files)
    }

    fn from_files(folder: &Path, mut files: BTreeMap<String, Vec<u8>>) -> Result<Self, PageError> {
        // The index differs by request: its compressed forms are of no use.
        files.retain(|name, _| !matches!(Coding::of_name(name), (INDEX, Coding::Brotli | Coding::Gzip)));
        let index = files.remove(INDEX).ok_or_else(|| PageError::NoIndex(folder.to_owned()))?;
        let index = String::from_utf8_lossy(&index);
        let mut places = index.match_indices(PLACEHOLDER).map(|(at, _)| at);
        let (Some(at), None) = (places.next(), places.next()) else {
            let count = index.matches(PLACEHOLDER).count();
            return Err(PageError::Placeholder(folder.join(INDEX), count));
        };
        let end = at + CONTENT_END;
        let index = (index[..end - "{}".len()].to_owned(), index[end..].to_owned());
        let mut assets: BTreeMap<String, Asset> = BTreeMap::new();
        for (name, contents) in files {
            let (original, coding) = Coding::of_name(&name);
            let tag = entity_tag(&contents);
            let asset = assets.entry(original.to_owned()).or_insert_with(|| Asset {
                content_type: content_type(original),
                immutable: has_hash(original),
                forms: BTreeMap::new(),
            });
            asset.forms.insert(coding, (contents.into(), tag));
        }
        match assets.iter().find(|(_, asset)| !asset.forms.contains_key(&Coding::Identity)) {
            Some((name, asset)) => {
                let suffix = if asset.forms.contains_key(&Coding::Brotli) { "br" } else { "gz" };
                Err(PageError::NoOriginal(folder.join(format!("{name}.{suffix}"))))
            }
            None => Ok(Self { index, assets }),
        }
    }

    /// The file of a request's path.
    pub(crate) fn asset(&self, path: &str) -> Option<&Asset> {
        self.assets.get(path.strip_prefix('/')?)
    }

    /// The page's files for a static host: name, content type, contents; compressed forms too, as their own types. Then the
    /// index, which names a published scene and its preview, as `index`.
    #[must_use]
    pub fn published(
        &self,
        scene: &str,
        preview: Option<Vec<u8>>,
        index: String,
    ) -> Vec<(String, &'static str, Bytes)> {
        let files = self.assets.iter().flat_map(|(name, asset)| {
            asset.forms.iter().map(move |(coding, (contents, _))| match coding {
                Coding::Brotli => (format!("{name}.br"), "application/octet-stream", contents.clone()),
                Coding::Gzip => (format!("{name}.gz"), "application/gzip", contents.clone()),
                Coding::Identity => (name.clone(), asset.content_type, contents.clone()),
            })
        });
        let name = preview.as_deref().map(lodestream_preview::file_name);
        let description = serde_json::json!({ "published": scene, "preview": name });
        let page = self.index(&description, name.as_deref()).into();
        let preview = name.zip(preview).map(|(name, bytes)| (name, "application/octet-stream", bytes.into()));
        files.chain(preview).chain([(index, content_type(INDEX), page)]).collect()
    }

    /// The index with a description of the server as JSON, and a link that lets browsers request the preview early.
    pub(crate) fn index(&self, description: &serde_json::Value, preview: Option<&str>) -> String {
        // In a script element only `<` could begin its end or a comment (HTML, section 4.12.1.3).
        let json = description.to_string().replace('<', "\\u003c");
        let link = preview.map_or(String::new(), |name| {
            format!("<link rel=\"preload\" href=\"./{name}\" as=\"fetch\" crossorigin />")
        });
        let (end, rest) = self.index.1.split_at(self.index.1.find('>').map_or(0, |at| at + 1));
        [&self.index.0, json.as_str(), end, &link, rest].concat()
    }
}

/// The strong entity tag of contents (RFC 9110, section 8.8.3).
pub(crate) fn entity_tag(contents: &[u8]) -> HeaderValue {
    let tag = format!("\"{}\"", &blake3::hash(contents).to_hex()[..32]);
    // Always: hexadecimal digits in quotation marks.
    HeaderValue::from_str(&tag).unwrap_or(HeaderValue::from_static("\"\""))
}

/// Whether a part of the name is a content hash, as in `lodestream-0123abcd.js`.
fn has_hash(name: &str) -> bool {
    name.split(['-', '.', '_']).any(|part| {
        part.len() >= HASH_DIGITS && part.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b))
    })
}

fn content_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map(|(_, extension)| extension) {
        Some("html") => "text/html; charset=utf-8",
        Some("js" | "mjs") => "text/javascript; charset=utf-8",
        Some("wasm") => "application/wasm",
        Some("css") => "text/css; charset=utf-8",
        Some("json" | "map") => "application/json",
        Some("webmanifest") => "application/manifest+json",
        Some("svg") => "image/svg+xml",
        Some("png") => "image/png",
        Some("jpg" | "jpeg") => "image/jpeg",
        Some("webp") => "image/webp",
        Some("ico") => "image/x-icon",
        Some("woff2") => "font/woff2",
        Some("txt") => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}
