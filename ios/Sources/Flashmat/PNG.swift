import Foundation

/// 8-bit PNG files, not compressed: small code, any platform. Viewers and engines recompress textures anyway.
enum PNG {
    /// A file of `channels` (1 or 3) interleaved codes, `width` x `height` pixels.
    static func file(_ codes: [UInt8], width: Int, height: Int, channels: Int) -> Data {
        var header = bigEndian(UInt32(width)) + bigEndian(UInt32(height))
        header += [8, channels == 1 ? 0 : 2, 0, 0, 0]
        var lines = [UInt8]()
        lines.reserveCapacity(codes.count + height)
        for y in 0..<height {
            lines.append(0)  // no filter
            lines += codes[y * width * channels..<(y + 1) * width * channels]
        }
        var file = Data([0x89, 0x50, 0x4E, 0x47, 0x0D, 0x0A, 0x1A, 0x0A])
        chunk("IHDR", header, to: &file)
        chunk("IDAT", zlib(lines), to: &file)
        chunk("IEND", [], to: &file)
        return file
    }

    /// A zlib stream (RFC 1950) of stored blocks.
    static func zlib(_ bytes: [UInt8]) -> [UInt8] {
        var out: [UInt8] = [0x78, 0x01]
        out.reserveCapacity(bytes.count + bytes.count / 65535 * 5 + 16)
        var start = 0
        repeat {
            let count = min(65535, bytes.count - start)
            let (low, high) = (UInt8(count & 0xFF), UInt8(count >> 8))
            out += [start + count == bytes.count ? 1 : 0, low, high, ~low, ~high]
            out += bytes[start..<start + count]
            start += count
        } while start < bytes.count
        return out + bigEndian(adler32(bytes))
    }

    static func adler32(_ bytes: [UInt8]) -> UInt32 {
        var (a, b) = (UInt32(1), UInt32(0))
        for byte in bytes {
            a = (a + UInt32(byte)) % 65521
            b = (b + a) % 65521
        }
        return b << 16 | a
    }

    static func crc32(_ bytes: some Sequence<UInt8>) -> UInt32 {
        ~bytes.reduce(~UInt32(0)) { crc, byte in table[Int((crc ^ UInt32(byte)) & 0xFF)] ^ crc >> 8 }
    }

    private static let table: [UInt32] = (0..<256).map { byte in
        (0..<8).reduce(UInt32(byte)) { crc, _ in crc & 1 == 1 ? 0xEDB8_8320 ^ crc >> 1 : crc >> 1 }
    }

    private static func bigEndian(_ value: UInt32) -> [UInt8] {
        [UInt8(value >> 24), UInt8(value >> 16 & 0xFF), UInt8(value >> 8 & 0xFF), UInt8(value & 0xFF)]
    }

    private static func chunk(_ kind: String, _ data: [UInt8], to file: inout Data) {
        let body = Array(kind.utf8) + data
        file.append(contentsOf: bigEndian(UInt32(data.count)))
        file.append(contentsOf: body)
        file.append(contentsOf: bigEndian(crc32(body)))
    }
}
