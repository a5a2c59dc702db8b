//! The container of binary glTF.

/// A GLB file of a JSON text and a binary chunk.
pub(crate) fn glb(json: &str, bin: &[u8]) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], bytes: &[u8], pad: u8| {
        let length = bytes.len().next_multiple_of(4);
        let mut chunk = (length as u32).to_le_bytes().to_vec();
        chunk.extend(kind);
        chunk.extend(bytes);
        chunk.resize(8 + length, pad);
        chunk
    };
    let body = [chunk(b"JSON", json.as_bytes(), b' '), chunk(b"BIN\0", bin, 0)].concat();
    let length = (body.len() as u32 + 12).to_le_bytes();
    [&b"glTF"[..], &2_u32.to_le_bytes(), &length, &body].concat()
}
