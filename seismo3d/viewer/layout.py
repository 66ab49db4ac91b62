"""What the page looks like: a Vue template over the state that :mod:`seismo3d.viewer.page` keeps."""

from __future__ import annotations

PANELS = ("inline", "crossline", "sample")
"""Names of the flat panels in the page's state, by the cube's axis."""

_PANEL = """
<div class="s3-panel" data-panel="@">
  <div class="s3-head">
    <span class="s3-label">{{ @_label }}</span>
    <input type="range" class="s3-slider" min="0" :max="@_count - 1" step="1"
      :value="@_index" @input="@_index = Number($event.target.value)" aria-label="@ slice" />
    <button class="s3-step" title="One line back" @click="@_index = Math.max(0, @_index - 1)">&#8249;</button>
    <button class="s3-step" title="One line on" @click="@_index = Math.min(@_count - 1, @_index + 1)">&#8250;</button>
  </div>
  <div class="s3-axes"><span>{{ @_left }}</span><span>{{ @_across }}</span><span>{{ @_right }}</span></div>
  <svg class="s3-view" :viewBox="'0 0 ' + @_columns + ' ' + @_rows" preserveAspectRatio="none"
    :style="{cursor: mode === 'look' ? 'pointer' : 'crosshair'}"
    @click="$event.detail < 2 && trigger('click', [#,
      $event.clientX - $event.currentTarget.getBoundingClientRect().left,
      $event.clientY - $event.currentTarget.getBoundingClientRect().top,
      $event.currentTarget.getBoundingClientRect().width, $event.currentTarget.getBoundingClientRect().height])">
    <g :transform="@_flip">
      <image :href="@_image" x="0" y="0" :width="@_columns" :height="@_rows" preserveAspectRatio="none" />
      <g fill="none" stroke-linecap="round" pointer-events="none">
        <line :x1="@_lines[0]" :x2="@_lines[0]" y1="0" :y2="@_rows" class="s3-cross" />
        <line x1="0" :x2="@_columns" :y1="@_lines[1]" :y2="@_lines[1]" class="s3-cross" />
        <path v-if="@_selected" :d="@_selected" class="s3-selected" />
        <path v-for="(part, k) in @_faults" :key="'h' + k" :d="part.d" class="s3-halo" />
        <path v-for="(part, k) in @_faults" :key="'f' + k" :d="part.d" :stroke="part.stroke" class="s3-fault" />
        <path v-for="part in @_horizons" :key="'t' + part.number" :d="part.d" :stroke="part.stroke" class="s3-horizon"
          :data-horizon="part.number" />
        <polyline v-if="@_picked.length" :points="@_picked.map((p) => p.join(',')).join(' ')" class="s3-stick" />
        <path v-for="(p, k) in @_picked" :key="'p' + k" :d="'M' + p[0] + ' ' + p[1] + 'l0 0.001'" class="s3-point" />
      </g>
    </g>
  </svg>
  <div class="s3-sides"><span>{{ @_top }}</span><span>{{ @_down }}</span><span>{{ @_bottom }}</span></div>
</div>
"""

_PAGE = """
<div class="s3-page">
  <div class="s3-bar">
    <b class="s3-title" :title="title">{{ title }}</b>
    <span class="s3-group" role="group" aria-label="What a click does">
      <button v-for="m in modes" :key="m.name" :data-mode="m.name" :title="m.help"
        :class="{'s3-on': mode === m.name}" @click="trigger('choose', ['mode', m.name])">{{ m.words }}</button>
    </span>
    <label v-if="mode === 'seed' || mode === 'stick'">reach
      <select :value="reach" data-choice="reach" @change="trigger('choose', ['reach', $event.target.value])">
        <option v-for="name in reaches" :key="name">{{ name }}</option></select></label>
    <button v-if="mode === 'stick'" data-do="trace" :disabled="busy || n_picked < 2"
      @click="trigger('trace')">Trace the stick</button>
    <label>faults by
      <select :value="attribute" data-choice="attribute"
        @change="trigger('choose', ['attribute', $event.target.value])">
        <option v-for="name in attributes" :key="name">{{ name }}</option></select></label>
    <span v-if="scale_colours.length" class="s3-scale">
      <span>{{ scale_low }}</span>
      <span class="s3-shades" :style="{background: 'linear-gradient(90deg,' + scale_colours.join(',') + ')'}"></span>
      <span>{{ scale_high }}</span></span>
    <label>amplitudes
      <select :value="cmap" data-choice="cmap" @change="trigger('choose', ['cmap', $event.target.value])">
        <option v-for="name in cmaps" :key="name">{{ name }}</option></select></label>
    <span class="s3-space"></span>
    <button data-do="undo" :disabled="busy || !undo_words" :title="undo_words" @click="trigger('undo')">Undo</button>
    <button data-do="redo" :disabled="busy || !redo_words" :title="redo_words" @click="trigger('redo')">Redo</button>
    <button data-do="save" :disabled="busy || !can_save"
      @click="trigger('save')">{{ saved ? 'Saved' : 'Save' }}</button>
  </div>
  <div class="s3-body">
    <div class="s3-grid">
      %(inline)s
      %(crossline)s
      %(sample)s
      <div class="s3-panel" data-panel="scene">
        <div class="s3-head">
          <span class="s3-group">
            <button data-view="scene" :class="{'s3-on': fourth === 'scene'}" @click="fourth = 'scene'">3D</button>
            <button data-view="map" :class="{'s3-on': fourth === 'map'}" @click="fourth = 'map'">Throw map</button>
          </span>
          <span class="s3-space"></span>
          <button v-if="fourth === 'scene'" class="s3-step" title="See all" @click="trigger('reset')">&#8962;</button>
        </div>
        <div v-show="fourth === 'scene'" class="s3-scene">%(scene)s</div>
        <img v-if="fourth === 'map' && map_image" :src="map_image" class="s3-map" alt="Throw, seen from above" />
      </div>
    </div>
    <div class="s3-list">
      <div class="s3-actions">
        <button data-do="delete" :disabled="busy || !chosen.length"
          @click="$event.detail < 2 && trigger('delete')">Delete</button>
        <button data-do="merge" :disabled="busy || chosen.length < 2"
          @click="$event.detail < 2 && trigger('merge')">Merge</button>
        <button :disabled="!chosen.length" @click="trigger('select', [[]])">None</button>
      </div>
      <table><thead><tr><th></th><th>area</th><th>throw</th><th>dip</th><th>conf.</th></tr></thead><tbody>
        <tr v-for="row in rows" :key="row.number" :data-row="row.number"
          :class="{'s3-chosen': chosen.includes(row.number)}"
          @click="trigger('toggle', [row.number])">
          <td><i v-if="row.colour" :style="{background: row.colour}"></i>{{ row.name }}</td>
          <template v-if="row.kind === 'fault'"><td>{{ row.area }}</td>
            <td>{{ row.throw === null ? '' : row.throw.toFixed(1) + ' ' + row.unit }}</td>
            <td>{{ row.dip?.toFixed(1) }}</td><td>{{ row.confidence.toFixed(2) }}</td></template>
          <td v-else colspan="4">on {{ row.share.toFixed(1) }} %% of all traces</td>
        </tr></tbody></table>
      <p v-if="!rows.length" class="s3-hint">No faults yet. Choose Stick, click two or more points down a break on one
        section, and trace it; or choose Seed and click on a reflector.</p>
    </div>
  </div>
  <div class="s3-status" role="status" :class="{'s3-bad': is_error}">
    <span v-if="busy" class="s3-busy"></span>{{ message }}</div>
</div>
"""

STYLE = """
html, body { overflow: hidden; margin: 0; }
.s3-page { height: 100vh; display: flex; flex-direction: column; font: 13px/1.35 system-ui, sans-serif;
  color: #1d2733; background: #f4f6f8; }
.s3-page button, .s3-page select { font: inherit; color: inherit; background: #fff; border: 1px solid #c3ccd6;
  border-radius: 4px; padding: 2px 9px; cursor: pointer; appearance: auto; }
.s3-page button { appearance: none; }
.s3-page button:disabled { color: #98a4b1; background: #eef1f4; cursor: default; }
.s3-page button:focus-visible, .s3-page select:focus-visible, .s3-page input:focus-visible {
  outline: 2px solid #0b6bcb; outline-offset: 1px; }
.s3-bar { display: flex; flex-wrap: wrap; gap: 6px 12px; align-items: center; padding: 6px 10px; background: #fff;
  border-bottom: 1px solid #d5dce4; }
.s3-title { max-width: 18em; overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
.s3-group button { border-radius: 0; margin-left: -1px; }
.s3-group button:first-child { border-radius: 4px 0 0 4px; }
.s3-group button:last-child { border-radius: 0 4px 4px 0; }
.s3-page .s3-on { background: #0b5cad; border-color: #0b5cad; color: #fff; }
.s3-space { flex: 1; }
.s3-scale { display: inline-flex; gap: 5px; align-items: center; font-size: 12px; }
.s3-shades { width: 110px; height: 12px; border-radius: 2px; border: 1px solid #aab4bf; }
.s3-body { flex: 1; min-height: 0; display: flex; }
.s3-grid { flex: 1; min-width: 0; display: grid; grid-template: 1fr 1fr / 1fr 1fr; gap: 6px; padding: 6px; }
.s3-panel { position: relative; min-width: 0; min-height: 0; display: grid; background: #fff;
  border: 1px solid #d5dce4; border-radius: 4px; padding: 2px 4px 4px; grid-template: auto auto 1fr / auto 1fr; }
.s3-panel[data-panel=scene] { grid-template: auto 1fr / 1fr; }
.s3-head { grid-column: 1 / -1; display: flex; gap: 6px; align-items: center; padding: 2px; }
.s3-label { min-width: 8.5em; font-weight: 600; }
.s3-slider { flex: 1; min-width: 40px; accent-color: #0b5cad; }
.s3-page .s3-step { padding: 0 7px; }
.s3-axes { grid-column: 2; display: flex; justify-content: space-between; font-size: 11px; color: #4d5a68; }
.s3-sides { grid-column: 1; grid-row: 3; display: flex; flex-direction: column; justify-content: space-between;
  font-size: 11px; color: #4d5a68; writing-mode: vertical-rl; transform: rotate(180deg); padding-right: 2px; }
.s3-sides { flex-direction: row-reverse; }
.s3-view { grid-column: 2; grid-row: 3; width: 100%; height: 100%; min-height: 0; display: block; background: #e9edf2; }
.s3-view image { image-rendering: auto; }
.s3-view path, .s3-view line, .s3-view polyline { vector-effect: non-scaling-stroke; }
.s3-cross { stroke: #0b5cad; stroke-width: 1; stroke-dasharray: 3 5; opacity: .55; }
.s3-halo { stroke: #10161d; stroke-width: 3.6; }
.s3-fault { stroke-width: 2.2; }
.s3-selected { stroke: #fff200; stroke-width: 8; opacity: .85; }
.s3-horizon { stroke-width: 2.4; paint-order: stroke; filter: drop-shadow(0 0 1px #000); }
.s3-stick { stroke: #ff2d87; stroke-width: 2; fill: none; }
.s3-point { stroke: #ff2d87; stroke-width: 8; }
.s3-scene { min-height: 0; position: relative; overflow: hidden; }
.s3-map { width: 100%; height: 100%; min-height: 0; object-fit: contain; }
.s3-list { width: 300px; overflow: auto; background: #fff; border-left: 1px solid #d5dce4; padding: 6px; }
.s3-actions { display: flex; gap: 6px; padding-bottom: 6px; position: sticky; top: -6px; background: #fff; }
.s3-list table { width: 100%; border-collapse: collapse; font-size: 12px; }
.s3-list th { text-align: right; font-weight: 600; color: #4d5a68; }
.s3-list td { text-align: right; padding: 2px 3px; border-top: 1px solid #edf0f3; white-space: nowrap; }
.s3-list td:first-child { text-align: left; }
.s3-list tr { cursor: pointer; }
.s3-list tbody tr:hover { background: #eef5fc; }
.s3-list .s3-chosen { background: #fff8b8; }
.s3-list i { display: inline-block; width: 10px; height: 10px; border-radius: 2px; margin-right: 4px; }
.s3-hint { color: #4d5a68; padding: 8px 2px; }
.s3-status { padding: 4px 10px; min-height: 27px; background: #fff; border-top: 1px solid #d5dce4; }
.s3-bad { color: #a3180f; }
.s3-busy { display: inline-block; width: 11px; height: 11px; margin-right: 7px; border-radius: 50%;
  border: 2px solid #0b5cad; border-right-color: transparent; animation: s3-turn 1s linear infinite; }
@keyframes s3-turn { to { transform: rotate(360deg); } }
@media (max-width: 900px) { .s3-list { width: 190px; } }
"""


def make_template(scene: str) -> str:
    """Return the page's template.

    Parameters
    ----------
    scene : str
        Template of the 3D view; empty where there is none.
    """
    panels = {name: _PANEL.replace("@_", f"{name}_") for name in PANELS}
    filled = {
        name: text.replace('data-panel="@"', f'data-panel="{name}"')
        .replace('"@ slice"', f'"{name} slice"')
        .replace("[#,", f"[{PANELS.index(name)},")
        for name, text in panels.items()
    }
    return _PAGE % {**filled, "scene": scene}
