import ij.IJ;
import ij.ImagePlus;
import ij.measure.Calibration;
import ij.process.ImageProcessor;
import java.awt.image.IndexColorModel;
import java.util.ArrayList;
import java.util.List;
import java.util.zip.CRC32;

/** What ImageJ makes of TIFF files, a JSON object a line. */
public class ImageJReads {
    public static void main(String[] files) {
        for (String file : files) {
            ImagePlus image = IJ.openImage(file);
            System.out.println(image == null ? "null" : told(image));
        }
        System.exit(0);
    }

    static String told(ImagePlus image) {
        Calibration scale = image.getCalibration();
        List<String> pages = new ArrayList<>();
        for (int n = 1; n <= image.getStackSize(); n++) {
            image.setSlice(n);
            pages.add(String.format("{\"label\": \"%s\", \"range\": [%s, %s], \"crc32\": %d}",
                image.getStack().getSliceLabel(n), image.getDisplayRangeMin(),
                image.getDisplayRangeMax(), sum(image.getStack().getProcessor(n))));
        }
        return String.format("{\"bits\": %d, \"frames\": %d, \"slices\": %d, \"unit\": \"%s\", "
            + "\"pixel\": [%s, %s], \"origin\": [%s, %s], \"interval\": %s, \"colours\": %s, "
            + "\"pages\": %s}", image.getBitDepth(), image.getNFrames(), image.getNSlices(),
            scale.getUnit(), scale.pixelWidth, scale.pixelHeight, scale.xOrigin, scale.yOrigin,
            scale.frameInterval, colours(image.getProcessor()), pages);
    }

    static List<List<Integer>> colours(ImageProcessor page) {
        IndexColorModel own = (IndexColorModel) page.getCurrentColorModel();
        List<List<Integer>> table = new ArrayList<>();
        for (int k = 0; k < own.getMapSize(); k++)
            table.add(List.of(own.getRed(k), own.getGreen(k), own.getBlue(k)));
        return table;
    }

    /** CRC-32 of a page's values as little-endian float32, with one kind of NaN. */
    static long sum(ImageProcessor page) {
        CRC32 sum = new CRC32();
        for (int k = 0; k < page.getPixelCount(); k++) {
            int bits = Float.floatToIntBits(page.getf(k));
            for (int j = 0; j < 4; j++) sum.update(bits >> 8 * j & 0xff);
        }
        return sum.getValue();
    }
}
