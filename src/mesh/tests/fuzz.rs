//! No content makes a reader panic, and what it lets pass is sound.

use proptest::prelude::*;

use super::*;

/// Reads `bytes` as the format of `extension`, and checks a mesh that comes of it.
fn try_read(extension: &str, bytes: &[u8]) {
    let surface = match extension.to_ascii_lowercase().as_str() {
        "ply" => super::super::ply::read(bytes),
        "obj" => super::super::obj::read(bytes),
        "stl" => super::super::stl::read(bytes),
        _ => super::super::gltf::read(bytes, None),
    };
    if let Some((mesh, _)) = surface.ok().and_then(|surface| from_surface(surface).ok()) {
        assert_sound(&mesh);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn readers_survive_random_bytes(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        for extension in ["ply", "obj", "stl", "gltf"] {
            try_read(extension, &bytes);
        }
    }

    #[test]
    fn readers_survive_random_bytes_after_a_sound_start(
        bytes in prop::collection::vec(any::<u8>(), 0..300),
        cut in 0.0..1.0,
    ) {
        for (extension, sound) in encoded(&sphere(1)) {
            let kept = (cut * sound.len() as f64) as usize;
            try_read(extension, &[&sound[..kept], &bytes].concat());
        }
    }

    #[test]
    fn readers_survive_damaged_bytes(
        hits in prop::collection::vec((0.0..1.0, any::<u8>()), 1..12),
    ) {
        for (extension, mut sound) in encoded(&sphere(1)) {
            for (place, value) in &hits {
                let place = (place * sound.len() as f64) as usize;
                sound[place] = *value;
            }
            try_read(extension, &sound);
        }
    }

    #[test]
    fn gltf_survives_damaged_json(
        hits in prop::collection::vec((0.0..1.0, 0usize..14, any::<u32>()), 1..6),
    ) {
        // Numbers and keywords of the JSON are exchanged; lengths are kept right.
        let bytes = glb(&sphere(1));
        let json_length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
        let mut json = String::from_utf8(bytes[20..20 + json_length].to_vec()).unwrap();
        for (place, kind, number) in hits {
            let digits: Vec<usize> = json.char_indices()
                .filter(|(_, c)| c.is_ascii_digit()).map(|(i, _)| i).collect();
            let at = digits[(place * digits.len() as f64) as usize];
            let with = match kind {
                0..=5 => (number % 10).to_string(),
                6 => number.to_string(),
                7 => "-1".to_owned(),
                8 => "null".to_owned(),
                9 => "4294967295".to_owned(),
                10 => "18446744073709551615".to_owned(),
                11 => "5121".to_owned(),
                12 => "1e30".to_owned(),
                _ => "5120,\"normalized\":true".to_owned(),
            };
            json.replace_range(at..at + 1, &with);
        }
        let bin = &bytes[20 + json_length..];
        let mut damaged = bytes[..8].to_vec();
        damaged.extend((20 + json.len() as u32 + bin.len() as u32).to_le_bytes());
        damaged.extend((json.len() as u32).to_le_bytes());
        damaged.extend(b"JSON");
        damaged.extend(json.as_bytes());
        damaged.extend(bin);
        try_read("glb", &damaged);
    }

    #[test]
    fn repair_makes_any_surface_sound(
        positions in prop::collection::vec(
            (prop::sample::select(vec![0.0, 1.0, -1.0, 0.5, 1e-9, 1e-160, 1e99, f64::NAN]),
             -2i8..3, prop::sample::select(vec![0.0, -0.0, 3.0, f64::INFINITY])), 1..12),
        picks in prop::collection::vec((any::<u16>(), any::<u16>(), any::<u16>()), 0..30),
        normals in any::<Option<u64>>(),
    ) {
        let count = positions.len() as u32;
        let positions: Vec<DVec3> =
            positions.into_iter().map(|(x, y, z)| DVec3::new(x, y.into(), z)).collect();
        let some = |seed: u64| (0..count).map(|v| {
            let bits = (seed >> (v * 3 % 60)) & 7;
            Vec3::new((bits & 1) as f32, (bits & 2) as f32 - 1.0, (bits & 4) as f32 / bits as f32)
        }).collect();
        let surface = Surface {
            positions,
            normals: normals.map(some),
            triangles: picks.into_iter()
                .map(|(a, b, c)| [a, b, c].map(|v| u32::from(v) % count)).collect(),
            ..Surface::default()
        };
        if let Ok((mesh, _)) = from_surface(surface) {
            assert_sound(&mesh);
        }
    }
}
