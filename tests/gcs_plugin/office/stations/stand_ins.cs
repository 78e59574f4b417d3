// The few interfaces of Mission Planner that the plugin uses, as its sources declare them, and a
// pilot's screen: reads one command a line, draws, and writes what is on it.
using System;
using System.Drawing;
using System.Globalization;
using System.Windows.Forms;

public partial class MAVLink
{
    public enum MAVLINK_MSG_ID { HEARTBEAT = 0, NAMED_VALUE_FLOAT = 251 }
    public struct mavlink_named_value_float_t { public uint time_boot_ms; public float value; public byte[] name; }
    public class MAVLinkMessage
    {
        public uint msgid { get; set; }
        public byte sysid { get; set; }
        public byte compid { get; set; }
        public object data;
        public T ToStructure<T>() { return (T)data; }
    }
}

namespace MissionPlanner
{
    public class MAVState { public byte sysid { get; set; } }
    public class MAVLinkInterface
    {
        public MAVState MAV = new MAVState { sysid = 1 };
        public event EventHandler<MAVLink.MAVLinkMessage> OnPacketReceived;
        public void Hear(MAVLink.MAVLinkMessage m) { if (OnPacketReceived != null) OnPacketReceived(this, m); }
    }
    namespace GCSViews { public class FlightData { public static Control myhud; } }
    namespace Plugin
    {
        public class PluginHost { public MAVLinkInterface comPort { get; set; } }
        public abstract class Plugin
        {
            public PluginHost Host { get; set; }
            public abstract string Name { get; }
            public abstract string Version { get; }
            public abstract string Author { get; }
            public abstract bool Init();
            public abstract bool Loaded();
            public virtual bool Loop() { return true; }
            public virtual float loopratehz { get; set; }
            public abstract bool Exit();
        }
    }
}

public static class Screen
{
    const int Wide = 204, High = 60;

    static void Write(ThrustMargin.Picture now)
    {
        var picture = new Bitmap(Wide, High);
        using (var on = Graphics.FromImage(picture))
            ThrustMargin.MarginBar.DrawOn(on, new Rectangle(0, 0, Wide, High), now);
        // Bright columns in the middle of the bar (it is 200 wide), and the colour of its left end.
        int filled = 0;
        for (int x = 2; x < 202; x++)
        {
            Color c = picture.GetPixel(x, 12);
            if (c.R + c.G + c.B > 60) filled++;
        }
        int tall = 0; // bright rows near its left end, of 20
        for (int y = 2; y < 22; y++)
        {
            Color c = picture.GetPixel(6, y);
            if (c.R + c.G + c.B > 60) tall++;
        }
        Color left = picture.GetPixel(6, 12), edge = picture.GetPixel(20, 2);
        Console.WriteLine("{0}|{1}|{2}|{3}|{4},{5},{6}|{7},{8},{9}", now.First, now.Second, filled,
            tall, left.R, left.G, left.B, edge.R, edge.G, edge.B);
    }

    public static void Main(string[] words)
    {
        if (words.Length == 1)
        {
            Console.WriteLine(string.Join("|", ThrustMargin.Figures.Actions));
            return;
        }
        var figures = new ThrustMargin.Figures();
        var plugin = new ThrustMargin.ThrustMarginPlugin();
        var link = new MissionPlanner.MAVLinkInterface();
        plugin.Host = new MissionPlanner.Plugin.PluginHost { comPort = link };
        plugin.Init();
        plugin.Loaded();
        plugin.Loop();
        var before = link;
        string line;
        while ((line = Console.ReadLine()) != null)
        {
            string[] part = line.Split(' ');
            double at = double.Parse(part[1], CultureInfo.InvariantCulture);
            if (part[0] == "draw") Write(figures.Draw(at));
            else if (part[0] == "current") { link.MAV.sysid = (byte)at; Write(plugin.Current()); }
            else if (part[0] == "relink")
            {
                before = link;
                link = plugin.Host.comPort = new MissionPlanner.MAVLinkInterface();
                plugin.Loop();
            }
            else if (part[0] == "packet" || part[0] == "stray")
            {
                var name = new byte[10];
                System.Text.Encoding.ASCII.GetBytes(part[2]).CopyTo(name, 0);
                (part[0] == "stray" ? before : link).Hear(new MAVLink.MAVLinkMessage { msgid = 251, sysid = (byte)at, compid = 25,
                    data = new MAVLink.mavlink_named_value_float_t { name = name,
                        value = float.Parse(part[3], CultureInfo.InvariantCulture) } });
            }
            else figures.Take(part[2], double.Parse(part[3], CultureInfo.InvariantCulture), at);
        }
    }
}
