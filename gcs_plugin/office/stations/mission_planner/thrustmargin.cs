// Thrust margin on the HUD of Mission Planner. Put this file into its folder `plugins`: it compiles
// it at start. The figures come by NAMED_VALUE_FLOAT from `thrustmargin monitor --announce`:
//   MARGIN      measured thrust margin of the worst rotor, %      MARGIN_PRE  as predicted
//   MARGIN_ROT  that rotor, from 1      MARGIN_LIM  smallest margin that may last, %
//   MARGIN_DO   what to do: a place in `Figures.Actions`
// A figure is shown as live for LIVE seconds. Older ones are never drawn as a bar: the field turns
// grey and says how old the last one is.

using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Drawing;
using System.Globalization;
using System.Text;
using System.Windows.Forms;
using MissionPlanner.GCSViews;

namespace ThrustMargin
{
    /// What is drawn at one moment; Share is that of the field's width, NaN for no bar.
    public class Picture
    {
        public double Share = double.NaN;
        public double LimitShare = double.NaN;
        public bool Measured;
        public bool Live;
        public Color Fill = Figures.NoData;
        public string First = "";
        public string Second = "";
    }

    /// The newest figures of one vehicle, each with the time at which it came.
    public class Figures
    {
        public const double Live = 3.0; // s
        public const double Forgotten = 60.0; // s after which even the old number is not shown
        public static readonly Color NoData = Color.FromArgb(165, 165, 165);
        public static readonly Color Good = Color.FromArgb(66, 140, 208);
        public static readonly Color Bad = Color.FromArgb(206, 66, 16);

        public static readonly string[] Actions =
        {
            "", "see messages", "fly gently", "slow down", "land", "CONTROL LOST"
        };

        private readonly Dictionary<string, double> values = new Dictionary<string, double>();
        private readonly Dictionary<string, double> times = new Dictionary<string, double>();
        private readonly HashSet<string> gone = new HashSet<string>(); // NaN came: no longer known

        public void Take(string name, double value, double now)
        {
            if (!name.StartsWith("MARGIN", StringComparison.Ordinal)) return;
            lock (values)
            {
                if (double.IsNaN(value) || double.IsInfinity(value))
                {
                    gone.Add(name);
                    return;
                }
                gone.Remove(name);
                values[name] = value;
                times[name] = now;
            }
        }

        private double Age(string name, double now)
        {
            return times.ContainsKey(name) ? now - times[name] : double.PositiveInfinity;
        }

        /// The value if it is live, else NaN.
        private double Now(string name, double now)
        {
            return Age(name, now) <= Live && !gone.Contains(name) ? values[name] : double.NaN;
        }

        public Picture Draw(double now)
        {
            lock (values) return Made(now);
        }

        private Picture Made(double now)
        {
            var made = new Picture();
            double measured = Now("MARGIN", now), predicted = Now("MARGIN_PRE", now);
            made.Measured = !double.IsNaN(measured);
            double margin = made.Measured ? measured : predicted;
            made.Live = !double.IsNaN(margin);
            if (!made.Live)
            {
                double age = Age("MARGIN", now);
                made.First = "Thrust left unknown";
                if (age <= Forgotten)
                    made.Second = "was " + Percent(values["MARGIN"]) + ", " + Seconds(age) + " ago";
                else
                    made.Second = "nothing heard";
                return made;
            }
            double limit = Now("MARGIN_LIM", now);
            made.Share = Math.Max(0.0, Math.Min(1.0, margin / 100.0));
            made.LimitShare = double.IsNaN(limit) ? limit : Math.Max(0.0, Math.Min(1.0, limit / 100.0));
            if (!double.IsNaN(limit)) made.Fill = margin < limit ? Bad : Good;
            double rotor = Now("MARGIN_ROT", now), act = Now("MARGIN_DO", now);
            made.First = (made.Measured ? "Thrust left " : "Predicted thrust left ") + Percent(margin);
            if (made.Measured && rotor >= 1.0) made.First += ", rotor " + Whole(rotor);
            made.Second = Seconds(Age(made.Measured ? "MARGIN" : "MARGIN_PRE", now)) + " old";
            if (act >= 1.0 && act < Actions.Length)
                made.Second = Actions[(int)act] + "  (" + made.Second + ")";
            return made;
        }

        /// Rounded down, so that what is below the limit also reads so.
        private static string Percent(double value)
        {
            return Whole(Math.Floor(value + 1e-6)) + "%";
        }

        private static string Seconds(double value)
        {
            return Whole(Math.Floor(value)) + " s";
        }

        private static string Whole(double value)
        {
            return value.ToString("0", CultureInfo.InvariantCulture);
        }
    }

    /// The field on the HUD.
    public class MarginBar : Control
    {
        private readonly Func<Picture> picture;

        public MarginBar(Func<Picture> picture)
        {
            this.picture = picture;
            Tag = "custom"; // Mission Planner's themes leave it as it is
            DoubleBuffered = true;
            TabStop = false;
        }

        /// Lower left, a third of the HUD's width, where the HUD has no text of its own.
        public void Place(int width, int height)
        {
            int high = Math.Max(36, height / 9);
            Bounds = new Rectangle(4, Math.Max(0, height / 2 - high / 2), Math.Max(150, width / 3), high);
        }

        protected override void OnPaint(PaintEventArgs e)
        {
            DrawOn(e.Graphics, ClientRectangle, picture());
        }

        public static void DrawOn(Graphics on, Rectangle field, Picture now)
        {
            using (var back = new SolidBrush(Color.FromArgb(17, 17, 17)))
                on.FillRectangle(back, field);
            var bar = new Rectangle(field.X + 2, field.Y + 2, field.Width - 4, field.Height / 3);
            using (var fill = new SolidBrush(now.Fill))
            using (var edge = new Pen(now.Fill))
            {
                on.DrawRectangle(edge, bar.X, bar.Y, bar.Width - 1, bar.Height - 1);
                if (now.Live)
                {
                    int wide = (int)Math.Round(bar.Width * now.Share);
                    // A prediction is a thin bar: it was not measured.
                    int inset = now.Measured ? 0 : bar.Height / 3;
                    on.FillRectangle(fill, bar.X, bar.Y + inset, wide, bar.Height - 2 * inset);
                }
            }
            if (now.Live && !double.IsNaN(now.LimitShare))
                using (var mark = new SolidBrush(Color.White))
                    on.FillRectangle(mark, bar.X + (int)Math.Round(bar.Width * now.LimitShare) - 1, bar.Y, 2, bar.Height);
            using (var ink = new SolidBrush(now.Live ? Color.White : Figures.NoData))
            using (var font = new Font(FontFamily.GenericSansSerif, Math.Max(7f, field.Height / 5f), GraphicsUnit.Pixel))
            {
                int line = (field.Height - bar.Height - 4) / 2;
                on.DrawString(now.First, font, ink, field.X + 1, bar.Bottom);
                on.DrawString(now.Second, font, ink, field.X + 1, bar.Bottom + line);
            }
        }
    }

    public class ThrustMarginPlugin : MissionPlanner.Plugin.Plugin
    {
        private readonly Dictionary<byte, Figures> vehicles = new Dictionary<byte, Figures>();
        private readonly Stopwatch clock = Stopwatch.StartNew();
        private MissionPlanner.MAVLinkInterface heard;
        private MarginBar bar;

        public override string Name { get { return "Thrust margin"; } }
        public override string Version { get { return "1"; } }
        public override string Author { get { return "thrustmargin"; } }

        public override bool Init()
        {
            loopratehz = 2;
            return true;
        }

        public override bool Loaded()
        {
            return true;
        }

        /// On a thread of the plugins: the link may have been replaced, the HUD may only be there now.
        public override bool Loop()
        {
            var link = Host.comPort;
            if (link != null && !ReferenceEquals(link, heard))
            {
                if (heard != null) heard.OnPacketReceived -= Take;
                link.OnPacketReceived += Take;
                heard = link;
            }
            var hud = FlightData.myhud;
            if (hud == null || !hud.IsHandleCreated) return true;
            hud.BeginInvoke((MethodInvoker)delegate { Show(hud); });
            return true;
        }

        public override bool Exit()
        {
            if (heard != null) heard.OnPacketReceived -= Take;
            return true;
        }

        private void Show(Control hud)
        {
            if (bar == null)
            {
                bar = new MarginBar(Current);
                hud.Controls.Add(bar);
                bar.BringToFront();
            }
            bar.Place(hud.Width, hud.Height);
            bar.Invalidate();
        }

        /// Of the vehicle that Mission Planner shows.
        public Picture Current()
        {
            var link = Host.comPort;
            return Of(link == null ? (byte)0 : (byte)link.MAV.sysid).Draw(clock.Elapsed.TotalSeconds);
        }

        private Figures Of(byte vehicle)
        {
            lock (vehicles)
            {
                if (!vehicles.ContainsKey(vehicle)) vehicles[vehicle] = new Figures();
                return vehicles[vehicle];
            }
        }

        private void Take(object sender, MAVLink.MAVLinkMessage message)
        {
            if (message.msgid != (uint)MAVLink.MAVLINK_MSG_ID.NAMED_VALUE_FLOAT) return;
            var said = message.ToStructure<MAVLink.mavlink_named_value_float_t>();
            string name = Encoding.ASCII.GetString(said.name).Split('\0')[0].Trim();
            Of(message.sysid).Take(name, said.value, clock.Elapsed.TotalSeconds);
        }
    }
}
