//! Seeds → damaged files: bytes, chunks, numbers and words changed, two files spliced; sums and lengths
//! of containers mended half of the time, so that the damage gets past them.

/// xorshift64*: a few lines, and the same on every machine.
pub(crate) struct Draw(u64);

impl Draw {
    /// The draws of one input of one parser.
    pub(crate) fn new(parser: &str, number: u64) -> Self {
        let name = parser.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, b| {
            (hash ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
        });
        let mut draw = Self((name ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15)) | 1);
        draw.next();
        draw.next();
        draw
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// A number below `end`; 0 where there is none.
    pub(crate) fn below(&mut self, end: usize) -> usize {
        ((u128::from(self.next()) * end as u128) >> 64) as usize
    }

    fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }
}

/// What kind of file the seeds are.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    /// Numbers and words are text somewhere: a whole file, or its header.
    Text,
    /// None are.
    Binary,
    /// glTF's container: text and binary, with lengths before them.
    Glb,
    /// Chunks with a length and a sum.
    Png,
    /// Stored entries with a sum.
    Zip,
}

const NUMBERS: [&str; 26] = [
    "nan",
    "NaN",
    "inf",
    "-inf",
    "-1",
    "0",
    "-0.0",
    "1",
    "2",
    "255",
    "256",
    "65536",
    "1000000000",
    "2147483647",
    "2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "1e308",
    "-1e308",
    "1e39",
    "1e-320",
    "1e999",
    "0.5",
    "1e20",
];

const WORDS: [&str; 46] = [
    " ",
    "\n",
    "\t",
    "\"",
    "'",
    "[",
    "]",
    "{",
    "}",
    ",",
    ":",
    "=",
    "/",
    "//",
    "#",
    "\\\n",
    "\0",
    "é",
    "element",
    "property",
    "list",
    "uchar",
    "uint",
    "double",
    "vertex",
    "face",
    "end_header",
    "f ",
    "v ",
    "vn ",
    "vt ",
    "solid",
    "endsolid",
    "endloop",
    "outer loop",
    "null",
    "true",
    "[[frames]]",
    "[object]",
    "vertex:",
    "schlick",
    "\"sparse\"",
    "\"byteStride\":",
    "data:,",
    "+X ",
    "-Y ",
];

const BYTES: [u8; 12] = [0, 1, 2, 3, 0x7f, 0x80, 0xfe, 0xff, b'\n', b' ', b'-', b'9'];

/// Input number `number` made of `seeds`; the first inputs are the seeds themselves.
pub(crate) fn input(parser: &str, form: Form, seeds: &[Vec<u8>], number: u64) -> Vec<u8> {
    if let Some(seed) = seeds.get(number as usize) {
        return seed.clone();
    }
    let mut draw = Draw::new(parser, number);
    let mut bytes = seeds[draw.below(seeds.len())].clone();
    for _ in 0..draw.of(&[1, 1, 1, 1, 2, 2, 3, 6]) {
        change(&mut draw, form, &mut bytes, seeds);
    }
    if draw.below(2) == 0 {
        match form {
            Form::Glb => mend_glb(&mut bytes),
            Form::Png => mend_png(&mut bytes),
            Form::Zip => mend_zip(&mut bytes),
            Form::Text | Form::Binary => {}
        }
    }
    // Splices may double a file at every change; what is long tells nothing new.
    bytes.truncate(1 << 17);
    bytes
}

/// One change.
fn change(draw: &mut Draw, form: Form, bytes: &mut Vec<u8>, seeds: &[Vec<u8>]) {
    // In text, most changes of a byte only break a word: half are of numbers, words and lines.
    let kind = match form {
        Form::Text | Form::Glb if draw.below(2) == 0 => 11 + draw.below(7),
        _ => draw.below(11),
    };
    // Headers are short and decide most: half of the changes are near the start.
    let near = if draw.below(2) == 0 { 256 } else { usize::MAX };
    let at = draw.below(bytes.len().min(near) + 1).min(bytes.len());
    let length = draw.of(&[1, 2, 3, 4, 8, 12, 50, 200]).min(bytes.len() - at);
    match kind {
        0 | 1 if at < bytes.len() => bytes[at] ^= 1 << draw.below(8),
        2 if at < bytes.len() => bytes[at] = draw.of(&BYTES),
        3 | 4 => {
            let word = binary_extreme(draw);
            let end = (at + word.len()).min(bytes.len());
            bytes.splice(at..end, word);
        }
        5 => drop(bytes.drain(at..at + length)),
        6 => {
            let chunk = bytes[at..at + length].to_vec();
            let to = draw.below(bytes.len() + 1);
            bytes.splice(to..to, chunk);
        }
        7 => {
            let byte = draw.of(&BYTES);
            bytes.splice(at..at, vec![byte; length]);
        }
        8 => bytes.truncate(draw.below(bytes.len() + 1)),
        9 | 10 => {
            let other = &seeds[draw.below(seeds.len())];
            let from = draw.below(other.len() + 1);
            bytes.truncate(at);
            bytes.extend(&other[from..]);
        }
        11..=14 => {
            let with = draw.of(&NUMBERS);
            if let Some(number) = text_number(draw, bytes, near) {
                bytes.splice(number, with.bytes());
            }
        }
        15 | 16 => {
            let word = draw.of(&WORDS);
            let end = if draw.below(2) == 0 { at } else { at + length };
            bytes.splice(at..end, word.bytes());
        }
        _ => {
            // A line again, or somewhere else.
            let lines: Vec<&[u8]> = bytes.split_inclusive(|&b| b == b'\n').collect();
            let line = lines
                .get(draw.below(lines.len()))
                .map_or(Vec::new(), |l| l.to_vec());
            let to: usize = lines
                .iter()
                .take(draw.below(lines.len() + 1))
                .map(|l| l.len())
                .sum();
            bytes.splice(to..to, line);
        }
    }
}

/// A word that means something extreme in some type, of either byte order.
fn binary_extreme(draw: &mut Draw) -> Vec<u8> {
    let mut word = match draw.below(6) {
        0 => draw
            .of(&[0u16, 1, 0x7fff, 0x8000, 0xffff, 0x7c00])
            .to_le_bytes()
            .to_vec(),
        1 | 2 => {
            let counts = [
                0,
                1,
                255,
                65536,
                1_000_000_000,
                0x7fff_ffff,
                0x8000_0000,
                u32::MAX,
            ];
            draw.of(&counts).to_le_bytes().to_vec()
        }
        3 => draw
            .of(&[1 << 20, 1 << 40, u64::MAX / 2, u64::MAX])
            .to_le_bytes()
            .to_vec(),
        4 => draw
            .of(&[f32::NAN, f32::INFINITY, -1.0, f32::MAX, 1e-40])
            .to_le_bytes()
            .to_vec(),
        _ => draw
            .of(&[f64::NAN, f64::NEG_INFINITY, 1e308, -1e-320])
            .to_le_bytes()
            .to_vec(),
    };
    if draw.below(4) == 0 {
        word.reverse();
    }
    word
}

/// Where a number stands as text, not farther in than `near`.
fn text_number(draw: &mut Draw, bytes: &[u8], near: usize) -> Option<std::ops::Range<usize>> {
    let of_number = |b: &u8| b.is_ascii_digit() || matches!(b, b'-' | b'+' | b'.');
    let from = draw.below(bytes.len().min(near));
    let start = from + bytes[from..].iter().position(of_number)?;
    let end = bytes[start..]
        .iter()
        .position(|b| !of_number(b) && *b != b'e');
    Some(start..end.map_or(bytes.len(), |length| start + length))
}

/// Sets both lengths of a packed glTF file by where its binary part begins.
fn mend_glb(bytes: &mut [u8]) {
    let length = bytes.len() as u32;
    if bytes.len() < 20 {
        return;
    }
    bytes[8..12].copy_from_slice(&length.to_le_bytes());
    let binary = bytes
        .windows(4)
        .position(|w| w == b"BIN\0")
        .unwrap_or(bytes.len() + 4);
    let json = (binary as u32).saturating_sub(4 + 20);
    bytes[12..16].copy_from_slice(&json.to_le_bytes());
    if let Some(head) = bytes.get_mut(binary - 4..binary) {
        head.copy_from_slice(&length.saturating_sub(binary as u32 + 4).to_le_bytes());
    }
}

/// Sets the sum of every chunk.
fn mend_png(bytes: &mut [u8]) {
    let mut at = 8;
    while let Some(&[a, b, c, d]) = bytes.get(at..at + 4) {
        let end = at + 8 + u32::from_be_bytes([a, b, c, d]) as usize;
        let Some(sum) = bytes.get(at + 4..end).map(crc32) else {
            return;
        };
        let Some(place) = bytes.get_mut(end..end + 4) else {
            return;
        };
        place.copy_from_slice(&sum.to_be_bytes());
        at = end + 4;
    }
}

/// Sets the sum of every stored entry that the directory lists.
fn mend_zip(bytes: &mut [u8]) {
    let word = |bytes: &[u8], at: usize| {
        let word = bytes.get(at..at + 4)?;
        Some(u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
    };
    let half = |bytes: &[u8], at: usize| word(bytes, at).map(|w| (w & 0xffff) as usize);
    for entry in 0..bytes.len().saturating_sub(46) {
        if &bytes[entry..entry + 4] != b"PK\x01\x02" {
            continue;
        }
        let Some((size, local)) = word(bytes, entry + 20).zip(word(bytes, entry + 42)) else {
            return;
        };
        let local = local as usize;
        let Some((name, extra)) = half(bytes, local + 26).zip(half(bytes, local + 28)) else {
            continue;
        };
        let start = local + 30 + name + extra;
        let Some(sum) = bytes.get(start..start + size as usize).map(crc32) else {
            continue;
        };
        for place in [entry + 16, local + 14] {
            bytes[place..place + 4].copy_from_slice(&sum.to_le_bytes());
        }
    }
}

/// The sum of PNG and zip (ISO 3309).
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| {
            (sum >> 1) ^ if sum & 1 == 1 { 0xedb8_8320 } else { 0 }
        })
    })
}
