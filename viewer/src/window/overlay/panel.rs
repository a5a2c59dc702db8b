//! The panel at the window's side: one at a time, small, and readable at any size of the window.

/// What the panel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::window) enum Panel {
    /// What keys do.
    Help,
    /// Figures about scene and stream.
    Information,
    /// The list of parts.
    Parts,
    /// Settings of the picture.
    Settings,
    /// Files to open.
    Open,
}

impl Panel {
    const fn title(self) -> &'static str {
        match self {
            Self::Help => "Keys",
            Self::Information => "Information",
            Self::Parts => "Parts",
            Self::Settings => "Picture",
            Self::Open => "Open",
        }
    }
}

/// Most of the window's width and height that a panel takes: less than a quarter of its area.
const MAX_WIDTH: f32 = 0.36;
const MAX_HEIGHT: f32 = 0.66;
/// Width in points that suffices.
const WIDTH: f32 = 300.0;
/// Points of the panel's borders, title and distance from the window's corner.
const BORDER: f32 = 16.0;
const TITLE: f32 = 36.0;
const MARGIN: f32 = 8.0;
/// Size of the text in points.
const TEXT: f32 = 12.0;

/// Draws a panel; returns whether it stays open.
pub(super) fn show(context: &egui::Context, panel: Panel, contents: impl FnOnce(&mut egui::Ui)) -> bool {
    let area = context.content_rect();
    let width = WIDTH.min(MAX_WIDTH * area.width()) - BORDER;
    let height = MAX_HEIGHT * area.height() - BORDER - TITLE;
    let mut open = true;
    let frame = egui::Frame::window(&context.global_style()).multiply_with_opacity(0.9);
    egui::Window::new(panel.title())
        .id(egui::Id::unique("panel"))
        .anchor(egui::Align2::RIGHT_TOP, [-MARGIN, MARGIN])
        .resizable(false)
        .collapsible(false)
        .open(&mut open)
        .frame(frame)
        .title_bar(true)
        .fixed_size([width, height.max(0.0)])
        .show(context, |ui| {
            egui::ScrollArea::both().auto_shrink([false, true]).max_height(height).show(ui, |ui| {
                let text = egui::FontId::proportional(TEXT);
                ui.style_mut().override_font_id = Some(text);
                ui.visuals_mut().override_text_color = Some(egui::Color32::from_gray(225));
                ui.spacing_mut().slider_width = 0.22 * width;
                contents(ui);
            });
        });
    open
}
