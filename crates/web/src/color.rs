//! Colours for models that were finished before their photographs came.

use epipole_mapper::Silent;
use epipole_mapper::stages::finish;
use wasm_bindgen::prelude::wasm_bindgen;

use crate::host::Host;
use crate::pictures::Decoded;
use crate::session::{Answer, Session};

#[wasm_bindgen]
impl Session {
    /// Colours the points of finished models by the photographs that are at hand, and sends the scene again. Opened models
    /// keep the colours they came with.
    pub async fn color(&self, host: Host) -> Answer<()> {
        let finished = self.models.borrow().iter().map(|model| model.reconstruction.clone()).collect::<Vec<_>>();
        if self.graph.is_none() || finished.is_empty() {
            return Ok(());
        }
        for (number, mut reconstruction) in finished.into_iter().enumerate() {
            let mut decoded = Decoded { pictures: &self.pictures, host: host.clone() };
            finish::color(&mut reconstruction, &mut decoded, &mut Silent).await;
            // A run may have put other models there meanwhile.
            let mut models = self.models.borrow_mut();
            let points = models.get_mut(number).map_or(&mut [][..], |model| &mut model.reconstruction.points);
            for (point, colored) in points.iter_mut().zip(reconstruction.points) {
                if point.position == colored.position {
                    point.rgb = colored.rgb;
                }
            }
        }
        let _ = host.send("snapshot", &self.snapshot()?);
        Ok(())
    }
}
