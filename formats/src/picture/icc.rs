//! The one thing that is read from an embedded ICC profile: what it calls itself.

/// Longest description that is passed on, in characters.
const LONGEST: usize = 80;

/// What `profile` calls itself, unless that is sRGB (colour or grey); a profile without a
/// readable description gives "unnamed ICC profile".
///
/// Source: ICC.1:2022 sections 7.3 (tag table), 10.15 (multiLocalizedUnicode), and ICC.1:2001-04
/// section 6.5.17 (textDescription).
pub(super) fn description_unless_srgb(profile: &[u8]) -> Option<String> {
    let description = description(profile).unwrap_or_default();
    let description: String =
        description.chars().filter(|c| !c.is_control()).take(LONGEST).collect::<String>().trim().to_owned();
    let lower = description.to_lowercase();
    let is_srgb = (lower.contains("srgb") || lower.contains("sgrey") || lower.contains("sgray"))
        && !lower.contains("linear");
    // "c2" and "c2ci": the well-known minimal sRGB profiles, which save bytes in their name too.
    if is_srgb || lower == "c2" || lower == "c2ci" {
        return None;
    }
    Some(if description.is_empty() { "unnamed ICC profile".to_owned() } else { description })
}

fn description(profile: &[u8]) -> Option<String> {
    let u32_at = |bytes: &[u8], at: usize| -> Option<usize> {
        let bytes = bytes.get(at..at.checked_add(4)?)?;
        Some(u32::from_be_bytes(bytes.try_into().ok()?) as usize)
    };
    let tags = u32_at(profile, 128)?.min(1024);
    let entry = (0..tags).map(|tag| 132 + 12 * tag).find(|&at| profile.get(at..at + 4) == Some(b"desc"))?;
    let (offset, size) = (u32_at(profile, entry + 4)?, u32_at(profile, entry + 8)?);
    let tag = profile.get(offset..offset.checked_add(size)?)?;
    match tag.get(..4)? {
        b"desc" => {
            let length = u32_at(tag, 8)?;
            let text = tag.get(12..12usize.checked_add(length)?)?;
            Some(text.iter().take_while(|&&byte| byte != 0).map(|&byte| char::from(byte)).collect())
        }
        b"mluc" => {
            let (length, start) = (u32_at(tag, 20)?, u32_at(tag, 24)?);
            let text = tag.get(start..start.checked_add(length)?)?;
            let units = text.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]]));
            Some(char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect())
        }
        _ => None,
    }
}
