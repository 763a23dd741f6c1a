//! Maps as ROS's map server reads them.

use std::path::Path;

/// The cells of a map that was exported for Nav2: what a place of the world is drawn in, 254 where
/// it is free; `None` outside.
pub fn exported_grid(folder: &Path) -> impl Fn(f64, f64) -> Option<u8> + use<> {
    let pgm = std::fs::read(folder.join("map.pgm")).unwrap();
    let mut head = pgm.splitn(5, |byte| *byte == b'\n');
    let (size, _, cells) = (head.nth(2).unwrap(), head.next(), head.next().unwrap().to_owned());
    let size = String::from_utf8(size.to_vec()).unwrap();
    let [width, height] =
        [0, 1].map(|part| size.split(' ').nth(part).unwrap().parse::<usize>().unwrap());
    let yaml = std::fs::read_to_string(folder.join("map.yaml")).unwrap();
    let origin = yaml.lines().find_map(|line| line.strip_prefix("origin: [")).unwrap();
    let [x, y] = [0, 1].map(|part| origin.split(", ").nth(part).unwrap().parse::<f64>().unwrap());
    move |x_m, y_m| {
        let [column, row] = [(x_m - x) / 0.05, (y_m - y) / 0.05];
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "small and positive"
        )]
        let (column, row) = (column as usize, row as usize);
        let is_within = x_m >= x && y_m >= y && column < width && row < height;
        is_within.then(|| cells[(height - 1 - row) * width + column])
    }
}
